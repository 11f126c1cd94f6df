"""What LogWriter leaves in the file, read back with plain h5py."""

import os
import subprocess
import sys
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import h5py
import numpy as np
import pytest

from campaigns.log import Channel, LogWriter, read_run, verify
from sim_backend.errors import ConfigError, DataError
from tests.small_disk import on_small_disk

BENCH = {"kind": "sim"}


def rows(count: int, value: float = 1.0) -> dict[str, np.ndarray]:
    return {"torque_x": np.full(count, value), "angle_x": np.full(count, -value)}


def test_plain_h5py_finds_what_was_written(small_log):
    path, data = small_log
    with h5py.File(path) as file:
        assert file.attrs["schema"] == "mccd-log/1"
        assert file.attrs["test"] == "hysteresis"
        assert file.attrs["status"] == "complete"
        assert file.attrs["configuration"] == "a = 1\n"
        assert file.attrs["seed"] == 5
        assert file.attrs["bench"] == '{"kind": "sim", "name": "bench"}'
        started, ended = (datetime.fromisoformat(file.attrs[key]) for key in ("started_utc", "ended_utc"))
        assert started.tzinfo is not None and ended >= started
        assert file["committed_rows"][()] == 1000
        for name, column in data.items():
            dataset = file["channels"][name]
            assert dataset.dtype == "<f8" and dataset.chunks == (128,) and dataset.fletcher32
            np.testing.assert_array_equal(dataset[:], column)
        angle = file["channels/angle_x"].attrs
        assert (angle["unit"], angle["role"], angle["dof"]) == ("rad", "output", "theta_x")
        assert (angle["sample_rate_hz"], angle["t0_s"]) == (10_000.0, 5e-5)
        table = file["segments"][:]
        assert [row["label"].decode() for row in table] == ["sweep up", "held-out µ"]
        assert [(row["start"], row["stop"]) for row in table] == [(0, 450), (550, 1000)]
        assert table["settings"][0] == b'{"amplitude_rad": 0.0045, "levels": [0, 1, 2]}'


def test_any_object_with_the_attributes_of_a_channel_is_taken(tmp_path):
    @dataclass(frozen=True)
    class Signal:
        name: str
        unit: str
        role: str
        dof: str
        sample_rate_hz: float
        t0_s: float

    with LogWriter.create(tmp_path / "a.h5", [Signal("z", "m", "output", "z", 1e4, 0.0)], test="t", bench=BENCH) as log:
        log.append({"z": [1.0, 2.0]})
    with read_run(tmp_path / "a.h5") as run:
        assert run.channels["z"] == Channel("z", "m", "output", "z", 1e4, 0.0)


def test_blocks_of_any_length_give_the_same_rows(tmp_path, channels):
    rng = np.random.default_rng(3)
    data = {"torque_x": rng.normal(size=5000), "angle_x": rng.normal(size=5000)}
    path = tmp_path / "a.h5"
    with LogWriter.create(path, channels, test="t", bench=BENCH, chunk_rows=64) as log:
        done = 0
        for count in (0, 1, 63, 64, 65, 128, 700, 3, 2000, 1976):  # below, at and above the chunk's 64 rows
            log.append({name: column[done : done + count] for name, column in data.items()})
            done += count
            assert log.rows == done
            assert log.committed_rows == done // 64 * 64
    assert done == 5000
    with h5py.File(path) as file:
        for name, column in data.items():
            np.testing.assert_array_equal(file["channels"][name][:], column)


def test_an_existing_path_is_never_overwritten(tmp_path, channels):
    path = tmp_path / "a.h5"
    path.write_text("precious")
    with pytest.raises(ConfigError, match="never overwrites"):
        LogWriter.create(path, channels, test="t", bench=BENCH)
    assert path.read_text() == "precious"
    assert [item.name for item in tmp_path.iterdir()] == ["a.h5"]


def test_an_exception_ends_the_run_as_failed_and_keeps_its_rows(tmp_path, channels):
    path = tmp_path / "a.h5"
    with pytest.raises(ZeroDivisionError), LogWriter.create(path, channels, test="t", bench=BENCH) as log:
        log.begin_segment("a")
        log.append(rows(10))
        raise ZeroDivisionError("by\0zero")
    with read_run(path) as run:
        assert (run.status, run.rows) == ("failed", 10)
        assert "ZeroDivisionError" in run.header.status_reason
        assert (run.segments[0].start, run.segments[0].stop) == (0, 10)


def test_an_interrupt_ends_the_run_as_aborted(tmp_path, channels):
    path = tmp_path / "a.h5"
    with pytest.raises(KeyboardInterrupt), LogWriter.create(path, channels, test="t", bench=BENCH) as log:
        log.append(rows(10))
        raise KeyboardInterrupt
    with read_run(path) as run:
        assert (run.status, run.rows) == ("aborted", 10)


def test_a_chosen_status_is_written(tmp_path, channels):
    path = tmp_path / "a.h5"
    with LogWriter.create(path, channels, test="t", bench=BENCH) as log:
        log.append(rows(1))
        log.set_status("paused", "asked to")
    with read_run(path) as run:
        assert (run.status, run.header.status_reason) == ("paused", "asked to")


@pytest.mark.parametrize(
    ("misuse", "message"),
    [
        (lambda log: log.append({"torque_x": [1.0]}), "append exactly these"),
        (lambda log: log.append({"torque_x": [1.0], "angle_x": [1.0, 2.0]}), "differ in shape"),
        (lambda log: log.append({"torque_x": [[1.0]], "angle_x": [[1.0]]}), "one-dimensional"),
        (lambda log: log.end_segment(), "no segment is open"),
        (lambda log: [log.begin_segment("a"), log.begin_segment("b")], "end that one first"),
        (lambda log: [log.begin_segment("a"), log.end_segment(), log.begin_segment("a")], "unique"),
        (lambda log: log.begin_segment("a", {"x": float("nan")}), "finite"),
        (lambda log: log.begin_segment("a", {"x": object()}), "JSON"),
        (lambda log: log.begin_segment("a", {"x": "y" * 2000}), "settings_bytes"),
        (lambda log: log.begin_segment("x" * 200), "128 bytes"),
        (lambda log: log.set_status("running"), "cannot end a run"),
        (lambda log: [log.close(), log.append(rows(1))], "closed"),
    ],
)
def test_misuse_is_refused_and_harms_nothing(tmp_path, channels, misuse, message):
    path = tmp_path / "a.h5"
    with LogWriter.create(path, channels, test="t", bench=BENCH) as log:
        log.append(rows(3))
        with pytest.raises(ConfigError, match=message):
            misuse(log)
    with read_run(path) as run:
        np.testing.assert_array_equal(run.read("angle_x"), [-1.0, -1.0, -1.0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"channels": []}, "at least one channel"),
        ({"channels": [Channel("a", "m", "input", "z", 1.0), Channel("a", "m", "input", "z", 1.0)]}, "unique"),
        ({"channels": [Channel("a", "m", "input", "z", 1.0), Channel("b", "m", "input", "z", 2.0)]}, "share one"),
        ({"bench": {"stiffness": 11.16}}, "no parameters"),
        ({"bench": {"model": "x" * 300}}, "no parameters"),
        ({"seed": -1}, "seed -1"),
        ({"started_utc": "2026-03-01T12:00:00"}, "zone"),
        ({"test": "a\nb"}, "cannot be a name"),
        ({"chunk_rows": 0}, "chunk_rows 0"),
    ],
)
def test_a_header_that_a_log_cannot_hold_leaves_no_file(tmp_path, channels, change, message):
    arguments = {"channels": channels, "test": "t", "bench": BENCH} | change
    with pytest.raises(ConfigError, match=message):
        LogWriter.create(tmp_path / "a.h5", arguments.pop("channels"), **arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a/b", "m", "input", "z", 1.0), "cannot be a name"),
        (("a", "mm", "input", "z", 1.0), "convert to 'm'"),
        (("a", "furlong", "input", "z", 1.0), "accepted are"),
        (("a", "m", "sideways", "z", 1.0), "input, output, reference, aux"),
        (("a", "m", "input", "z", 0.0), "0.0 Hz"),
        (("a", "m", "input", "z", float("nan")), "nan Hz"),
        (("a", "m", "input", "z", 1.0, float("inf")), "inf s"),
    ],
)
def test_a_channel_that_a_log_cannot_hold_is_refused(arguments, message):
    with pytest.raises(ConfigError, match=message):
        Channel(*arguments)


def test_a_missing_folder_is_a_clear_error(tmp_path, channels):
    with pytest.raises(DataError, match="No such file or directory"):
        LogWriter.create(tmp_path / "absent" / "a.h5", channels, test="t", bench=BENCH)


FILL_UP = """
import os, sys
import numpy as np
from campaigns.log import Channel, LogWriter
from sim_backend.errors import DataError

path, unplug_at = sys.argv[1], int(sys.argv[2])
try:
    with LogWriter.create(path, [Channel("z", "m", "output", "z", 1e4)], test="t", bench={}, chunk_rows=512) as log:
        for block in range(1000):
            if block == unplug_at:  # from now on the system refuses every write to the file
                device, inode = os.stat(path).st_dev, os.stat(path).st_ino
                for handle in map(int, os.listdir("/proc/self/fd")):
                    if handle > 2 and os.path.exists(f"/proc/self/fd/{handle}"):
                        found = os.fstat(handle)
                        if (found.st_dev, found.st_ino) == (device, inode):
                            os.dup2(os.open(path, os.O_RDONLY), handle)
            log.append({"z": np.full(512, float(block))})
except DataError as error:
    print(log.committed_rows, error)
del log
"""


def check_cut_short(path: Path, result: subprocess.CompletedProcess[str], reason: str, status: str) -> int:
    assert result.returncode == 0, result.stderr
    committed, message = result.stdout.split(" ", 1)
    assert f"cannot write the log {path}: {reason}" in message and message.count("\n") == 1
    with read_run(path) as run:
        assert (run.status, run.rows) == (status, int(committed))
        np.testing.assert_array_equal(run.read("z"), np.repeat(np.arange(run.rows // 512, dtype=float), 512))
    return int(committed)


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="needs /proc to find the file's descriptor")
def test_a_file_that_can_no_longer_be_written_is_a_clear_error_and_keeps_its_rows(tmp_path):
    path = tmp_path / "a.h5"
    command = [sys.executable, "-c", FILL_UP, str(path), "20"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert check_cut_short(path, result, "Bad file descriptor", "crashed") == 20 * 512


def test_a_full_disk_is_a_clear_error_and_keeps_the_committed_rows(tmp_path):
    disk = tmp_path / "disk"
    script = '"$1" -c "$2" "$3/a.h5" -1'
    result = on_small_disk(disk, "300k", script, sys.executable, FILL_UP, str(disk))
    # 300 kB hold 73 chunks of 4 kB, less the file's own tables, the 75 kB that segments may take and those of closing
    assert check_cut_short(disk / "a.h5", result, "No space left on device", "failed") >= 20 * 512
    assert verify(disk / "a.h5").ok


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="this system cannot take room before it is needed")
@pytest.mark.parametrize("filled", [0, 100, 511, 512])
def test_rows_that_have_their_room_fit_whatever_happens_to_the_rest_of_the_disk(tmp_path, filled):
    """Rows in chunks of 512; after `reserve` others take all that is left, and the log is still completed."""
    script = """
import sys
import numpy as np
from campaigns.log import Channel, LogWriter
channels = [Channel(n, "m", "output", n, 1e4) for n in "xyz"]
with LogWriter.create("a.h5", channels, test="t", bench={}, chunk_rows=512) as log:
    filled, rows = int(sys.argv[1]), 5000
    log.append({n: np.arange(filled, dtype=float) for n in "xyz"})
    log.reserve(rows)
    try:
        with open("ballast", "wb", buffering=0) as ballast:
            while ballast.write(bytes(4096)):
                pass
    except OSError as error:
        assert error.errno == 28
    for first in range(filled, filled + rows, 100):
        with log.segment(f"from {first}", {}):
            log.append({n: np.arange(first, first + 100, dtype=float) for n in "xyz"})
"""
    disk = tmp_path / "disk"
    done = on_small_disk(disk, "1m", '"$1" -c "$2" "$3"', sys.executable, script, str(filled))
    assert (done.returncode, done.stderr) == (0, "")
    with read_run(disk / "a.h5") as run:
        assert (run.status, run.rows) == ("complete", filled + 5000)
        assert all(np.array_equal(run.read(name), np.arange(run.rows)) for name in "xyz")
    assert verify(disk / "a.h5").ok


def test_room_that_was_not_needed_is_given_back(tmp_path, channels):
    sizes = []
    for rows in (0, 10**6):
        path = tmp_path / f"{rows}.h5"
        with LogWriter.create(
            path, channels, test="t", bench=BENCH, run_uid="x", started_utc="2026-01-01T00:00Z"
        ) as log:
            log.reserve(rows)
        sizes.append(path.stat().st_size)
    assert sizes[0] == sizes[1] < 2**17


def test_writing_with_checksums_keeps_up_with_fifty_benches(tmp_path):
    """10 kHz x 16 channels, timed by the process, so a busy machine passes; a third of the 50 times asked for."""
    import time

    channels = [Channel(f"c{index}", "rad", "output", "z", 1e4) for index in range(16)]
    data = np.random.default_rng(1).normal(size=(16, 200_000))
    began = time.process_time()
    with LogWriter.create(Path(tmp_path) / "a.h5", channels, test="t", bench=BENCH) as log:
        for first in range(0, 200_000, 2000):
            log.append({f"c{index}": data[index, first : first + 2000] for index in range(16)})
    assert 20.0 / (time.process_time() - began) > 50.0 / 3.0
