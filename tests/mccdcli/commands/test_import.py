"""`mccd import` writes a log that a plain HDF5 reader finds the source's numbers in."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from mccdcli.main import main

MAP = """
[log]
test = "free-run"
source = "data.csv"
sample_rate_hz = 1000.0
[channels.torque]
select = "tx"
unit = "mN m"
role = "input"
dof = "theta_x"
[channels.angle]
select = "ax"
unit = "mrad"
role = "output"
dof = "theta_x"
[segments]
"sweep up" = [0, 40]
"held-out" = [40, 100]
"""


@pytest.fixture
def map_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a map beside its data, in a folder that is not the current one."""
    folder = tmp_path / "bench"
    folder.mkdir()
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    rows = "\n".join(f"{k},{2 * k}" for k in range(100))
    (folder / "data.csv").write_text(f"tx,ax\n{rows}\n")
    (folder / "mirror.toml").write_text(MAP)
    return folder / "mirror.toml"


def test_the_log_holds_the_numbers_in_si(map_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", str(map_file), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["path"], report["rows"], report["sample_rate_hz"]) == ("mirror.h5", 100, 1000.0)
    assert [(s["label"], s["start"], s["stop"]) for s in report["segments"]] == [
        ("sweep up", 0, 40),
        ("held-out", 40, 100),
    ]
    with h5py.File("mirror.h5") as file:
        # two roundings, of the factor and of the product: 2 x 2^-53 relative
        np.testing.assert_allclose(file["channels/torque"], np.arange(100) * 1e-3, rtol=2.3e-16)
        np.testing.assert_allclose(file["channels/angle"], np.arange(100) * 2e-3, rtol=2.3e-16)
        assert file["channels/angle"].attrs["unit"] == "rad"


def test_for_a_person_the_summary_comes_first(map_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["import", str(map_file), "-o", "run.h5"]) == 0
    assert capsys.readouterr().out.startswith("run.h5: 100 samples at 1000 Hz, 0.1 s\n")


def test_an_existing_log_is_left_alone(map_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("mirror.h5").write_text("mine")
    assert main(["import", str(map_file)]) == 2
    assert "mirror.h5" in capsys.readouterr().err
    assert Path("mirror.h5").read_text() == "mine"


def test_bad_data_are_one_line_and_exit_code_4(map_file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (map_file.parent / "data.csv").write_text("tx,ax\n1,2\n3,nan\n")
    assert main(["import", str(map_file)]) == 4
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("mccd: error: ") and err.count("\n") == 1
    assert not Path("mirror.h5").exists()


def test_an_unknown_field_of_the_map_is_answered_with_the_nearest(
    map_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    map_file.write_text(MAP.replace("sample_rate_hz", "sample_rate"))
    assert main(["import", str(map_file)]) == 2
    assert "did you mean 'sample_rate_hz'?" in capsys.readouterr().err


@pytest.mark.parametrize("place", ["absolute", "above", "a link", "a linked folder", "a process"])
def test_a_map_reads_nothing_outside_its_folder_unless_allowed(map_file, tmp_path, capsys, place):
    folder = map_file.parent
    secret = tmp_path / "secret.csv"
    (folder / "data.csv").rename(secret)
    if place == "a link":
        (folder / "data.csv").symlink_to(secret)
    if place == "a linked folder":
        (folder / "data").symlink_to(tmp_path)
    sources = {"absolute": str(secret), "above": "../secret.csv", "a linked folder": "data/secret.csv"}
    source = {**sources, "a process": "/proc/self/environ"}.get(place, "data.csv")
    map_file.write_text(MAP.replace('"data.csv"', f'"{source}"'))
    assert main(["import", str(map_file)]) == 2
    said = capsys.readouterr().err
    for part in (source, f"outside the folder of the map, {folder}", "--allow-outside"):
        assert part in said
    assert "0,0" not in said and "PATH=" not in said
    if place != "a process":
        assert main(["import", str(map_file), "--allow-outside"]) == 0


def test_data_in_the_folder_may_be_named_in_any_way(map_file):
    folder = map_file.parent
    (folder / "below").mkdir()
    (folder / "data.csv").rename(folder / "below" / "data.csv")
    (folder / "linked.csv").symlink_to("below/data.csv")
    for k, source in enumerate(("below/data.csv", "./below/../linked.csv", str(folder / "below/data.csv"))):
        map_file.write_text(MAP.replace('"data.csv"', f'"{source}"'))
        assert main(["import", str(map_file), "-o", f"{k}.h5"]) == 0


def test_a_guess_for_data_elsewhere_says_what_its_map_needs(map_file, capsys):
    folder = map_file.parent
    assert main(["import", "--guess", str(folder / "data.csv"), "-o", "map.toml"]) == 0
    assert "`mccd import map.toml --allow-outside`" in capsys.readouterr().out
    assert main(["import", "--guess", str(folder / "data.csv"), "-o", str(folder / "map.toml")]) == 0
    assert "map.toml`" in capsys.readouterr().out


@pytest.mark.parametrize("idle", [("--note", "mine"), ("--allow-outside",)])
def test_an_option_of_a_map_is_refused_beside_a_guess(idle: tuple[str, ...], map_file: Path, capsys) -> None:
    assert main(["import", "--guess", str(map_file.with_name("data.csv")), "-o", "map.toml", *idle]) == 2
    assert f"{idle[0]} goes with a map" in capsys.readouterr().err and not Path("map.toml").exists()
