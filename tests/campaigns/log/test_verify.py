"""Verification finds every flipped bit; recovery saves what is sound and nothing else."""

import random
import shutil
import subprocess
from pathlib import Path

import h5py
import numpy as np
import pytest

from campaigns.log import LogWriter, read_run, recover, sidecar_of, verify
from sim_backend.errors import ConfigError, DataError


def flip(path: Path, position: int, bit: int) -> None:
    content = bytearray(path.read_bytes())
    content[position] ^= 1 << bit
    path.write_bytes(content)


def failed(path: Path) -> set[str]:
    return {check.name for check in verify(path).checks if not check.ok}


def test_a_sound_log_passes_and_sha256sum_agrees(small_log):
    path, _ = small_log
    report = verify(path)
    assert report.ok and {check.name for check in report.checks} == {
        "checksum",
        "schema",
        "status",
        "counter",
        "chunks",
    }
    assert sidecar_of(path).read_text() == f"{report.sha256}  small.h5\n"
    if shutil.which("sha256sum"):
        subprocess.run(["sha256sum", "-c", "--quiet", "small.h5.sha256"], cwd=path.parent, check=True)


def test_any_flipped_bit_is_found(small_log):
    path, _ = small_log
    sound, size = path.read_bytes(), path.stat().st_size
    rng = random.Random(1)
    for _ in range(12):
        flip(path, rng.randrange(size), rng.randrange(8))
        assert "checksum" in failed(path)
        path.write_bytes(sound)
    flip(sidecar_of(path), 5, 0)
    assert failed(path) == {"checksum"}


def test_a_bit_flipped_in_the_values_is_found_without_the_sidecar_and_never_read(small_log):
    path, data = small_log
    position = path.read_bytes().index(data["angle_x"][300:301].tobytes())
    flip(path, position, 3)
    sidecar_of(path).unlink()
    assert failed(path) == {"checksum", "chunks"}
    with read_run(path) as run:
        np.testing.assert_array_equal(run.read("angle_x", 0, 256), data["angle_x"][:256])
        with pytest.raises(DataError, match="angle_x"):
            run.read("angle_x", 299, 302)


def test_a_missing_or_senseless_sidecar_is_a_failure(small_log):
    path, _ = small_log
    sidecar_of(path).unlink()
    assert failed(path) == {"checksum"}
    for content in ("", "abc  small.h5\n", "g" * 64 + "  small.h5\n", "a" * 5000):
        sidecar_of(path).write_text(content)
        assert failed(path) == {"checksum"}


def test_a_file_that_is_no_log_fails_and_a_missing_one_raises(tmp_path):
    (tmp_path / "a.h5").write_text("no log")
    assert failed(tmp_path / "a.h5") == {"checksum", "schema"}
    with pytest.raises(DataError, match=r"absent\.h5"):
        verify(tmp_path / "absent.h5")


def test_a_log_being_written_is_no_failure_and_a_crashed_one_is(tmp_path, channels):
    path, copy = tmp_path / "live.h5", tmp_path / "copy.h5"
    with LogWriter.create(path, channels, test="t", bench={}, chunk_rows=16) as log:
        log.append({"torque_x": np.arange(40.0), "angle_x": np.arange(40.0)})
        shutil.copyfile(path, copy)
    assert failed(copy) == {"checksum", "status"}
    assert verify(path).ok


def test_rows_that_were_stored_but_not_committed_are_told(small_log):
    path, _ = small_log
    with h5py.File(path, "r+") as file:
        file["committed_rows"][()] = 900
    assert failed(path) == {"checksum", "counter"}


def test_recovery_saves_the_rows_before_the_damage(small_log, tmp_path):
    path, data = small_log
    before = path.read_bytes()
    with read_run(path) as run:
        run_uid = run.run_uid
    flip(path, before.index(data["angle_x"][600:601].tobytes()), 0)
    damaged = path.read_bytes()
    saved = recover(path, tmp_path / "saved.h5")
    assert (saved.rows, saved.committed_rows) == (512, 1000)  # chunks of 128 rows, the damaged row is in the fifth
    assert path.read_bytes() == damaged
    assert verify(saved.path).ok
    with read_run(saved.path) as run:
        assert (run.status, run.run_uid) == ("crashed", run_uid)
        assert "512 of 1000" in run.header.status_reason and "angle_x" in run.header.status_reason
        assert [(part.label, part.start, part.stop) for part in run.segments] == [("sweep up", 0, 450)]
        for name, column in data.items():
            np.testing.assert_array_equal(run.read(name), column[:512])


def test_recovery_overwrites_nothing_and_says_when_nothing_is_left(small_log, tmp_path, channels):
    path, data = small_log
    (tmp_path / "saved.h5").write_text("precious")
    with pytest.raises(ConfigError, match="never overwrites"):
        recover(path, tmp_path / "saved.h5")
    assert (tmp_path / "saved.h5").read_text() == "precious"
    flip(path, path.read_bytes().index(data["torque_x"][:1].tobytes()), 0)
    with pytest.raises(DataError, match="no sound sample"):
        recover(path, tmp_path / "other.h5")
    assert not (tmp_path / "other.h5").exists()
