"""Nothing that lies on a disk is believed: not a checksum, not a size, not that a file is a file."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import threading
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from campaigns.log import Channel, LogWriter, own, probe, read_run, recover, sidecar_of, verify
from campaigns.log.child import bound_memory, may_fork
from campaigns.log.limits import MAX_CHANNELS, MAX_SEGMENTS, MAX_TEXT_BYTES
from campaigns.log.summary import summarise
from mccdcli.main import main
from sim_backend.errors import ConfigError, DataError
from tests.campaigns.log.conftest import two_channels, values

ROOT = Path(__file__).parents[3]


def started(monkeypatch) -> list[int]:
    """Return a list that grows by one for each child that is started from now on."""
    probe._end()  # noqa: SLF001 a child of a test before
    children: list[int] = []
    start = probe._started  # noqa: SLF001

    def counted():
        reader = start()
        children.append(reader.process.pid)
        return reader

    monkeypatch.setattr(probe, "_started", counted)
    return children


def instead(monkeypatch, code: str) -> None:
    """Let children do `code` from now on."""
    probe._end()  # noqa: SLF001 a child of a test before
    monkeypatch.setattr(probe, "may_fork", lambda: False)
    monkeypatch.setattr(probe, "CHILD", code)


def test_a_log_of_this_process_needs_no_child_and_a_changed_one_does(small_log, seal, monkeypatch):
    path, _ = small_log
    children = started(monkeypatch)
    read_run(path).close()
    assert children == []
    with h5py.File(path, "r+") as file:
        file.attrs["status_reason"] = "x" * len(file.attrs["status_reason"])
    read_run(seal(path)).close()
    assert len(children) == 1


def test_a_log_that_another_writes_under_the_same_number_is_looked_at(tmp_path, monkeypatch):
    with LogWriter.create(tmp_path / "a.h5", two_channels(), test="t", bench={}) as log:
        log.append(values(10))
    copy = (tmp_path / "a.h5").read_bytes()
    stated = (tmp_path / "a.h5").stat()
    (tmp_path / "a.h5").write_bytes(copy)
    os.utime(tmp_path / "a.h5", ns=(stated.st_atime_ns, stated.st_mtime_ns))  # the time of writing, set back
    assert not own.is_own(tmp_path / "a.h5")


def test_one_child_looks_at_all_logs_of_a_command(tmp_path, seal, monkeypatch):
    paths = []
    for index in range(4):
        path = tmp_path / f"{index}.h5"
        with LogWriter.create(path, two_channels(), test="t", bench={}) as log:
            log.append(values(10))
        (tmp_path / f"copy{index}.h5").write_bytes(path.read_bytes())
        paths.append(seal(tmp_path / f"copy{index}.h5"))
    children = started(monkeypatch)
    for path in paths:
        read_run(path).close()
    (tmp_path / "broken.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + b"\0" * 4000)
    with pytest.raises(DataError):
        read_run(seal(tmp_path / "broken.h5"))
    assert len(children) == 1


def test_a_child_is_a_copy_only_where_that_is_safe(unsealed, monkeypatch):
    """A copy of a process with threads may wait for ever, and takes a file that is open there for open in itself."""
    monkeypatch.setattr(probe, "may_fork", lambda: True)
    probe._end()  # noqa: SLF001
    (copy := unsealed.with_name("copy.h5")).write_bytes(unsealed.read_bytes())
    with read_run(copy) as run:
        assert probe._kept[0].process.args == [sys.executable]  # noqa: SLF001
        probe._end()  # noqa: SLF001
        with read_run(copy) as again:
            np.testing.assert_array_equal(again.read("angle_x"), run.read("angle_x"))
        assert probe._kept[0].process.args[1:3] == ["-P", "-c"]  # noqa: SLF001
    stop = threading.Event()
    other = threading.Thread(target=stop.wait)
    other.start()
    assert not may_fork()
    stop.set()
    other.join()


@pytest.mark.parametrize("size", [0, 2**64 - 1])
def test_a_sealed_log_that_hangs_the_library_is_refused(unsealed, seal, monkeypatch, size):
    monkeypatch.setattr("campaigns.log.probe.time_limit_s", lambda _path: 1.0)
    content = bytearray(unsealed.read_bytes())
    heap = content.index(b"GCOL")
    content[heap + 24 : heap + 32] = size.to_bytes(8, "little")
    unsealed.write_bytes(content)
    seal(unsealed)
    started_s = time.monotonic()
    with pytest.raises(DataError, match=r"small\.h5"):
        read_run(unsealed)
    assert time.monotonic() - started_s < 20.0
    assert main(["log", "show", str(unsealed)]) == 4


def many_shallow(path: Path) -> None:
    """Channels below the size that is looked at one by one: 64 GiB in a file of some megabytes."""
    with h5py.File(path, "r+") as file:
        attributes = dict(file["channels/angle_x"].attrs)
        packed = zeros_of_a_chunk()
        for index in range(256):
            channel = file["channels"].create_dataset(f"x{index}", (2**25,), "f8", chunks=(2**20,), compression=9)
            for name, value in attributes.items():
                channel.attrs[name] = value
            channel.id.write_direct_chunk((0,), packed)


def zeros_of_a_chunk() -> bytes:
    import zlib

    return zlib.compress(bytes(2**23), 9)


def large_attribute(path: Path) -> None:
    """A text of fixed length, as files of the newest form hold of any size: refused before any of it is read."""
    content = path.with_name("content.h5")
    path.rename(content)
    with h5py.File(path, "w", libver="latest") as file, h5py.File(content) as old:
        for name in old:
            old.copy(name, file)
        for name, value in old.attrs.items():
            if name != "configuration":
                file.attrs[name] = value
        kind = h5py.h5t.C_S1.copy()
        kind.set_size(MAX_TEXT_BYTES + 1)
        attribute = h5py.h5a.create(file.id, b"configuration", kind, h5py.h5s.create(h5py.h5s.SCALAR))
        attribute.write(np.array(b"x", "S1"), mtype=h5py.h5t.C_S1)


@pytest.mark.parametrize(("make", "said"), [(many_shallow, "together"), (large_attribute, "bytes of at most")])
def test_a_sealed_log_that_unpacks_to_more_than_the_memory_is_refused(unsealed, seal, make, said):
    make(unsealed)
    script = r"""
import re, resource, sys
from mccdcli.main import main
code = main(["log", "summary", sys.argv[1]])
# ru_maxrss of a process begins with that of the one that started it
own = int(re.search(r"VmHWM:\s+(\d+)", open("/proc/self/status").read())[1])
print(code, 1024 * own, 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
    command = [sys.executable, "-c", script, str(seal(unsealed))]
    run = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=60)
    code, *peaks = map(int, run.stdout.split())
    assert code == 4 and said in run.stderr and run.stderr.count("\n") == 1
    assert sum(peaks) < 2**30


def test_a_chunk_that_is_shorter_than_it_must_be_is_never_read(unsealed):
    """HDF5 gives what lies behind it in the memory of whoever reads."""
    with h5py.File(unsealed, "r+") as file:
        file["channels/angle_x"].id.write_direct_chunk((0,), b"abcd" * 10, filter_mask=1)
    with pytest.raises(DataError, match="another size"):
        read_run(unsealed)


def pipe(path: Path) -> None:
    os.mkfifo(path)


def endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def folder(path: Path) -> None:
    path.mkdir()


@pytest.mark.parametrize("make", [pipe, endless, folder])
@pytest.mark.parametrize("command", ["show", "summary", "verify"])
def test_a_sidecar_that_is_no_file_is_refused_at_once(small_log, capsys, make, command):
    path, _ = small_log
    sidecar_of(path).unlink()
    make(sidecar_of(path))
    started_s = time.monotonic()
    assert main(["log", command, str(path)]) in (1, 4)
    assert "is not a checksum" in "".join(capsys.readouterr())
    assert time.monotonic() - started_s < 10.0


@pytest.mark.parametrize("make", [pipe, endless, folder])
def test_a_log_that_is_no_file_is_refused_at_once(tmp_path, make):
    make(tmp_path / "a.h5")
    with pytest.raises(DataError, match="not a file"):
        read_run(tmp_path / "a.h5")
    with pytest.raises(DataError, match=r"a\.h5"):
        verify(tmp_path / "a.h5")


def channels_of(count: int) -> list[Channel]:
    return [Channel(f"x{k}", "rad", "output", "z", 100.0) for k in range(count)]


def test_more_channels_than_a_reader_takes_are_refused_before_anything_is_written(tmp_path):
    with pytest.raises(ConfigError, match="4097 channels of at most 4096.*several logs"):
        LogWriter.create(tmp_path / "a.h5", channels_of(MAX_CHANNELS + 1), test="t", bench={})
    assert list(tmp_path.iterdir()) == []


def test_more_segments_and_longer_texts_than_a_reader_takes_are_refused_when_writing(tmp_path, monkeypatch):
    with pytest.raises(ConfigError, match="200001 segments of at most 200000"):
        LogWriter.create(tmp_path / "a.h5", channels_of(1), test="t", bench={}, expected_segments=MAX_SEGMENTS + 1)
    with pytest.raises(ConfigError, match="configuration takes .* shorten it"):
        LogWriter.create(tmp_path / "a.h5", channels_of(1), test="t", bench={}, configuration="x" * (2**24 + 1))
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr("campaigns.log.limits.MAX_SEGMENTS", 1)
    with LogWriter.create(tmp_path / "a.h5", channels_of(1), test="t", bench={}) as log:
        log.begin_segment("a")
        log.end_segment()
        with pytest.raises(ConfigError, match="2 segments of at most 1"):
            log.begin_segment("b")


@pytest.mark.soak
def test_as_many_channels_as_may_be_written_are_read(tmp_path, seal):
    path, rows = tmp_path / "a.h5", 70
    with LogWriter.create(path, channels_of(MAX_CHANNELS), test="t", bench={}, chunk_rows=16) as log:
        log.append({f"x{k}": np.arange(rows) + k for k in range(MAX_CHANNELS)})
    (tmp_path / "copy.h5").write_bytes(path.read_bytes())
    with read_run(seal(tmp_path / "copy.h5")) as run:
        assert run.rows == rows and run.read("x4095")[-1] == 4095 + rows - 1


MANY = """
import sys
import numpy as np
from campaigns.log import Channel, LogWriter
rows, count = 66_000, 2_200
column = np.arange(rows, dtype=float)
channels = [Channel(f"x{k}", "rad", "output", "z", 100.0) for k in range(count)]
with LogWriter.create(sys.argv[1], channels, test="t", bench={}, chunk_rows=2**16) as log:
    log.append({channel.name: column for channel in channels})
"""


@pytest.mark.soak
def test_a_sound_log_of_thousands_of_channels_is_not_called_damaged(tmp_path):
    path = tmp_path / "a.h5"
    subprocess.run([sys.executable, "-c", MANY, str(path)], check=True, cwd=ROOT)
    assert verify(path).ok
    with read_run(path) as run:
        assert summarise(run)[-1].rows == 66_000


def test_a_block_of_many_channels_has_fewer_rows(tmp_path, monkeypatch):
    monkeypatch.setattr("campaigns.log.read.BLOCK_VALUES", 100)
    with LogWriter.create(tmp_path / "a.h5", channels_of(3), test="t", bench={}, chunk_rows=8) as log:
        log.append({f"x{k}": np.arange(100.0) for k in range(3)})
    with read_run(tmp_path / "a.h5") as run:
        blocks = [block["x0"] for _, block in run.blocks()]
    assert {block.size for block in blocks} == {32, 4}  # whole chunks of at most 33 rows
    np.testing.assert_array_equal(np.concatenate(blocks), np.arange(100.0))


def test_a_reader_without_memory_says_so_and_recovery_drops_no_row(unsealed, tmp_path, monkeypatch):
    short = "import resource\nfrom campaigns.log import look\n"
    short += "look.bound_memory = lambda: None\n"
    short += "def read(*_): raise MemoryError\nlook.Run.stored = read\nlook.child()"
    instead(monkeypatch, short)
    with pytest.raises(DataError, match="more memory than its reader may") as caught:
        recover(unsealed, tmp_path / "saved.h5")
    assert "is damaged" not in str(caught.value) and not (tmp_path / "saved.h5").exists()
    with pytest.raises(DataError, match="more memory"):
        verify(unsealed)


def test_a_reader_that_is_kept_waiting_is_no_damage_and_recovery_drops_no_row(unsealed, tmp_path, monkeypatch):
    instead(monkeypatch, "import time; print('ready', flush=True); time.sleep(600)")
    monkeypatch.setattr(probe, "time_limit_s", lambda _path: 0.1)
    monkeypatch.setattr("campaigns.log.child.WAIT_S", 0.5)
    with pytest.raises(DataError, match="took too long.*busy, try again") as caught:
        recover(unsealed, tmp_path / "saved.h5")
    assert "damaged" not in str(caught.value) and not (tmp_path / "saved.h5").exists()


def test_memory_is_bounded_above_what_a_process_has():
    script = f"from {bound_memory.__module__} import bound_memory; bound_memory(); bytearray(2**30)"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd=ROOT)
    assert "MemoryError" in run.stderr
    assert resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY  # of this process
