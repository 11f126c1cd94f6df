"""An exported log, read back by the libraries that its users have."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat

from campaigns.log import Channel, LogWriter, read_run
from campaigns.log.export import FORMS, save, to_dataset, to_frame
from mccdcli.main import main
from sim_backend.errors import ConfigError
from tests.running import unmeasured

RNG = np.random.default_rng(3)
VALUES = {"torque": RNG.normal(size=50), "1st θ/2": RNG.normal(size=50), "1st θ 2": RNG.normal(size=50)}
VALUES = {name.replace("/", " per "): value for name, value in VALUES.items()}
UNITS = dict(zip(VALUES, ("N m", "rad", "rad"), strict=True))
T0_S, RATE_HZ = 0.25, 1000.0


@pytest.fixture
def log(tmp_path: Path) -> Path:
    channels = [Channel(n, UNITS[n], "input" if n == "torque" else "output", "theta_x", RATE_HZ, T0_S) for n in VALUES]
    with LogWriter.create(tmp_path / "run.h5", channels, test="chop", bench={"kind": "sim"}, seed=4) as writer:
        for label, part in (("up", slice(0, 30)), ("held-out", slice(30, 50))):
            with writer.segment(label, {"frequency_hz": 5.0}):
                writer.append({n: v[part] for n, v in VALUES.items()})
    return tmp_path / "run.h5"


TIME_S = T0_S + np.arange(50) / RATE_HZ


def test_pandas(log):
    with read_run(log) as run:
        frame = to_frame(run)
    for name, values in VALUES.items():
        np.testing.assert_array_equal(frame[name], values)
    np.testing.assert_allclose(frame.index, TIME_S, rtol=1e-15)
    assert frame.attrs["units"] == UNITS


def test_xarray(log):
    pytest.importorskip("xarray")
    with read_run(log) as run:
        found = to_dataset(run)
    np.testing.assert_array_equal(found["torque"], VALUES["torque"])
    assert found["torque"].attrs == {"units": "N m", "role": "input", "dof": "theta_x"}
    assert found["time"].attrs["units"] == "s"
    np.testing.assert_array_equal(found["torque"][found["segment"] == "held-out"], VALUES["torque"][30:])


def test_csv(log, tmp_path):
    assert main(["log", "export", str(log), "-o", str(tmp_path / "run.csv")]) == 0
    frame = pd.read_csv(tmp_path / "run.csv")
    assert list(frame.columns) == ["time (s)", *(f"{n} ({u})" for n, u in UNITS.items())]
    for name, values in VALUES.items():
        np.testing.assert_array_equal(frame[f"{name} ({UNITS[name]})"], values)


def test_npz(log, tmp_path):
    assert main(["log", "export", str(log), "-o", str(tmp_path / "run.npz"), "--json"]) == 0
    with np.load(tmp_path / "run.npz", allow_pickle=False) as found:
        np.testing.assert_array_equal(found["torque"], VALUES["torque"])
        about = json.loads(str(found["about"]))
    assert about["seed"] == 4 and about["channels"]["torque"]["unit"] == "N m"
    assert about["segments"][1] == {"label": "held-out", "start": 30, "stop": 50, "settings": {"frequency_hz": 5.0}}


def test_matlab(log, tmp_path):
    with read_run(log) as run:
        save(run, tmp_path / "run.mat")
    found = loadmat(tmp_path / "run.mat", simplify_cells=True)["run"]
    np.testing.assert_array_equal(found["channels"]["torque"], VALUES["torque"])
    # names that MATLAB cannot have are changed, and stay apart
    names = sorted(found["channels"])
    assert len(names) == 3 and all(name.isidentifier() and name.isascii() for name in names)
    assert {found["units"][name] for name in names} == {"N m", "rad"}
    first, last = int(found["segments"]["first"][1]), int(found["segments"]["last"][1])
    assert found["segments"]["label"][1] == "held-out"
    np.testing.assert_array_equal(found["channels"]["torque"][first - 1 : last], VALUES["torque"][30:50])
    np.testing.assert_allclose(found["time_s"], TIME_S, rtol=1e-15)
    assert [json.loads(text) for text in found["segments"]["settings"]] == [{"frequency_hz": 5.0}] * 2
    about = json.loads(found["about"])
    assert about["seed"] == 4 and about["channels"]["torque"]["unit"] == "N m"


@pytest.mark.skipif(shutil.which("octave") is None, reason="octave is not installed")
def test_octave_reads_the_matlab_file(log, tmp_path):
    import subprocess

    with read_run(log) as run:
        save(run, tmp_path / "run.mat")
    script = "load('run.mat'); printf('%.17g', run.channels.torque(7))"
    done = subprocess.run(
        ["octave-cli", "--eval", script], cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60
    )
    assert float(done.stdout) == VALUES["torque"][6]


def test_nexus(log, tmp_path):
    with read_run(log) as run:
        save(run, tmp_path / "run.nxs")
    # a viewer walks from the root along `default` to the group whose `signal` it plots over its `axes`
    with h5py.File(tmp_path / "run.nxs") as file:
        assert file.attrs["NX_class"] == "NXroot"
        entry = file[file.attrs["default"]]
        assert entry.attrs["NX_class"] == "NXentry"
        data = entry[entry.attrs["default"]]
        assert data.attrs["NX_class"] == "NXdata"
        signal, time = data[data.attrs["signal"]], data[data.attrs["axes"][0]]
        np.testing.assert_array_equal(signal[:], VALUES["1st θ per 2"])
        np.testing.assert_allclose(time[:], TIME_S, rtol=1e-15)
        assert signal.attrs["units"] == "rad" and time.attrs["units"] == "s"
        assert list(data.attrs["auxiliary_signals"]) == ["1st θ 2"]
        assert entry["input"].attrs["signal"] == "torque"


def test_nothing_is_overwritten_and_an_unknown_form_is_told(log, tmp_path):
    with read_run(log) as run:
        for ending in FORMS:
            save(run, tmp_path / f"x{ending}")
            with pytest.raises(ConfigError, match="not overwritten"):
                save(run, tmp_path / f"x{ending}")
        with pytest.raises(ConfigError, match=r"did you mean '\.mat'\? there are"):
            save(run, tmp_path / "x.matt")


def test_a_model_is_converted_both_ways(tmp_path, capsys):
    assert main(["model", "convert", "design", "-o", str(tmp_path / "d.json")]) == 0
    assert main(["model", "convert", str(tmp_path / "d.json"), "-o", str(tmp_path / "d.toml")]) == 0
    from sim_backend.model import load_model

    assert load_model(tmp_path / "d.toml") == load_model("design")
    assert main(["model", "convert", "design", "-o", str(tmp_path / "d.json")]) == 2
    assert "--force" in capsys.readouterr().err
    assert main(["model", "convert", "design", "-o", str(tmp_path / "d.yaml")]) == 2


@pytest.fixture
def clashing(tmp_path: Path) -> Path:
    """A log whose channels are named like entries of the files, and alike in their first 63 letters."""
    long = "station_2_mirror_stage_tip_tilt_position_sensor_filtered_reading_"
    names = ("time", "time_s", "about", "segment", "time_", f"{long}x", f"{long}y")
    channels = [Channel(name, "s", "output", "a", 1e3) for name in names]
    with LogWriter.create(tmp_path / "clash.h5", channels, test="t", bench={"kind": "imported", "name": "n"}) as log:
        log.append({name: np.arange(40.0) + 100.0 * i for i, name in enumerate(names)})
    return tmp_path / "clash.h5"


@pytest.mark.parametrize("ending", [".npz", ".mat", ".nxs", ".csv"])
def test_every_channel_is_kept_whatever_its_name(clashing, tmp_path, ending):
    target = tmp_path / f"out{ending}"
    with read_run(clashing) as run:
        save(run, target)
        wanted = {name: run.read(name) for name in run.channels}
    if ending == ".npz":
        found = dict(np.load(target))
        about = json.loads(str(found["about"]))
        times = found["time_s"]
    elif ending == ".mat":
        whole = loadmat(target, simplify_cells=True)["run"]
        found, about, times = whole["channels"], json.loads(whole["about"]), whole["time_s"]
    elif ending == ".nxs":
        with h5py.File(target) as file:
            group = file["entry/output"]
            found, times = {name: group[name][()] for name in group}, group["time"][()]
            about = json.loads(file["entry/about/data"][()])
    else:
        frame = pd.read_csv(target, index_col=0)
        found, times = {name.removesuffix(" (s)"): frame[name].to_numpy() for name in frame}, frame.index.to_numpy()
        about = {"channels": {name: {"stored_as": name if name != "time" else "time_2"} for name in wanted}}
    np.testing.assert_allclose(times, np.arange(40) * 1e-3, atol=1e-12)
    for name, values in wanted.items():
        np.testing.assert_array_equal(found[about["channels"][name]["stored_as"]], values)


@pytest.mark.parametrize("ending", FORMS)
def test_half_a_file_is_not_left_behind(clashing, tmp_path, ending):
    folder = tmp_path / "out"
    folder.mkdir()

    def fails(*_progress: object) -> None:
        raise KeyboardInterrupt

    with read_run(clashing) as run, pytest.raises(KeyboardInterrupt):
        save(run, folder / f"out{ending}", fails)
    assert list(folder.iterdir()) == []


FULL_DISK = """
import resource, signal, sys
from mccdcli.main import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
for ending in sys.argv[2:]:
    print(main(["log", "export", sys.argv[1], "-o", f"out{ending}"]))
"""


def test_a_full_disk_is_told_and_leaves_no_file(tmp_path):
    channels = [Channel(n, "rad", "output", "theta_x", RATE_HZ) for n in ("theta_x", "theta_y")]
    with LogWriter.create(tmp_path / "run.h5", channels, test="t", bench={"kind": "sim"}) as writer:
        writer.append({c.name: RNG.normal(size=20_000) for c in channels})
    folder = tmp_path / "out"
    folder.mkdir()
    command = [sys.executable, "-W", "error", "-c", FULL_DISK, str(tmp_path / "run.h5"), *FORMS]
    done = subprocess.run(command, cwd=folder, env=unmeasured(), capture_output=True, text=True, timeout=120)
    assert done.stdout.split() == ["4"] * len(FORMS)
    reason = "File too large; check the folder, its rights and the free space"
    assert done.stderr.splitlines() == [f"mccd: error: out{ending}: {reason}" for ending in FORMS]
    assert list(folder.iterdir()) == []
