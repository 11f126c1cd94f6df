"""A log that is longer than what is read at once: in every form and number whole, and never read whole."""

from __future__ import annotations

import tracemalloc

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.io import loadmat

from campaigns.log import Channel, LogWriter, Run, read_run
from campaigns.log.export import save
from campaigns.log.limits import BLOCK_ROWS
from campaigns.log.summary import summarise
from mccdcli.main import main
from sim_backend.errors import ConfigError, DataError

ROWS = 3 * BLOCK_ROWS + 7
RATE_HZ = 1000.0
RNG = np.random.default_rng(5)
VALUES = {
    # a small motion on a large offset, as of a temperature or a position: squares alone would lose it
    "offset": 1e6 + 1e-3 * RNG.normal(size=ROWS),
    "drifting": 5.0 + np.linspace(-1.0, 2.0, ROWS) + RNG.normal(size=ROWS),
    "still": np.full(ROWS, 0.1),
}


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("large") / "run.h5"
    channels = [Channel(name, "K", "output", name, RATE_HZ, 0.5) for name in VALUES]
    with LogWriter.create(path, channels, test="rest", bench={"kind": "sim"}) as writer:
        writer.append(VALUES)
    return path


@pytest.fixture(autouse=True)
def in_parts(monkeypatch):
    """Fail where more than a block of rows is read at once."""
    read = Run.read

    def watched(run, name, start=0, stop=None):
        assert (run.rows if stop is None else stop) - start <= BLOCK_ROWS
        return read(run, name, start, stop)

    monkeypatch.setattr(Run, "read", watched)


def exported(log, folder, ending):
    with read_run(log) as run:
        save(run, folder / f"run{ending}")
    return folder / f"run{ending}"


TIME_S = 0.5 + np.arange(ROWS) / RATE_HZ


def test_csv(log, tmp_path):
    frame = pd.read_csv(exported(log, tmp_path, ".csv"))
    assert list(frame.columns) == ["time (s)", *(f"{name} (K)" for name in VALUES)]
    np.testing.assert_array_equal(frame["time (s)"], TIME_S)
    for name, values in VALUES.items():
        np.testing.assert_array_equal(frame[f"{name} (K)"], values)


def test_npz(log, tmp_path):
    with np.load(exported(log, tmp_path, ".npz"), allow_pickle=False) as found:
        assert set(found.files) == {"time_s", "about", *VALUES}
        np.testing.assert_array_equal(found["time_s"], TIME_S)
        for name, values in VALUES.items():
            np.testing.assert_array_equal(found[name], values)


def test_nexus(log, tmp_path):
    with h5py.File(exported(log, tmp_path, ".nxs")) as file:
        data = file["entry/output"]
        np.testing.assert_array_equal(data["time"][:], TIME_S)
        for name, values in VALUES.items():
            np.testing.assert_array_equal(data[name][:], values)


def test_matlab(log, tmp_path):
    tracemalloc.start()
    try:
        path = exported(log, tmp_path, ".mat")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    # a block of times or values takes its numbers, what they are made from and their bytes; all rows take 12 blocks
    assert peak < 5 * 8 * BLOCK_ROWS
    found = loadmat(path, simplify_cells=True)["run"]
    np.testing.assert_array_equal(found["time_s"], TIME_S)
    for name, values in VALUES.items():
        np.testing.assert_array_equal(found["channels"][name], values)


def test_matlab_is_refused_what_its_form_cannot_hold(log, tmp_path, monkeypatch):
    monkeypatch.setattr("campaigns.log.export.MAT_BYTES", 8 * 4 * ROWS - 1)
    with pytest.raises(ConfigError, match=r"holds 0.00629 GB.*\.nxs"):
        exported(log, tmp_path, ".mat")
    assert not (tmp_path / "run.mat").exists()


def test_a_summary_in_blocks_is_that_of_the_whole(log):
    with read_run(log) as run:
        found = {one.name: one for one in summarise(run)}
    assert list(found) == list(VALUES)
    for name, values in VALUES.items():
        one = found[name]
        assert (one.rows, one.smallest, one.largest, one.unit) == (ROWS, values.min(), values.max(), "K")
        # a mean of n numbers is rounded by less than n · 1.1e-16 of them when added one by one, numpy adds pairwise
        assert one.mean == pytest.approx(values.mean(), rel=1e-13)
        # deviations of 1e-3 from 1e6 are known to 1e6 · 1.1e-16 / 1e-3 = 1.2e-7 of them
        assert one.std == pytest.approx(values.std(), rel=1e-6, abs=1e-12)


def test_the_command_summarises_one_line_per_channel(log, capsys):
    assert main(["log", "summary", str(log)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + len(VALUES)
    assert lines[-1].split()[:4] == ["still", "K", "0.1", "0.1"]


def test_a_log_without_rows_has_no_summary(tmp_path):
    with LogWriter.create(tmp_path / "run.h5", [Channel("a", "K", "aux", "a", 1.0)], test="x", bench={}):
        pass
    with read_run(tmp_path / "run.h5") as run, pytest.raises(DataError, match="no samples"):
        summarise(run)
