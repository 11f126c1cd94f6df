"""Sources made to do harm end in one clear line, inside bounds of memory and time, and leave no log behind."""

from __future__ import annotations

import resource
import struct
import subprocess
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from campaigns.importing import isolated
from campaigns.log import child
from mccdcli.main import main
from tests.campaigns.log.test_hostile import HOSTILE, mutated

MAP = """[log]
test = "free-run"
source = "{source}"
sample_rate_hz = 1000.0
[channels.x]
select = "{select}"
unit = "rad"
role = "output"
"""


@pytest.fixture
def imported(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch):
    """Return a function that imports `select` of a source by the real command: its exit code and what it said."""
    monkeypatch.chdir(tmp_path)

    def run(source: str, select: str = "x") -> tuple[int, str]:
        for name in ("out.h5", "out.h5.sha256"):
            (tmp_path / name).unlink(missing_ok=True)
        (tmp_path / "map.toml").write_text(MAP.format(source=source, select=select))
        code = main(["import", "map.toml", "-o", "out.h5"])
        said = capsys.readouterr().err
        assert (code == 0) == (tmp_path / "out.h5").exists()
        assert code == 0 or (said.startswith("mccd: error: ") and said.count("\n") == 1)
        return code, said

    return run


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("suffix", ["h5", "mat"])
def test_a_hostile_dataset_is_refused(tmp_path, imported, name, suffix):
    with h5py.File(tmp_path / "secret.h5", "w") as secret:
        secret["data"] = np.full(1000, 42.0)
    (tmp_path / "secret.raw").write_bytes(np.full(1000, 42.0).tobytes())
    with h5py.File(tmp_path / f"a.{suffix}", "w") as file:
        HOSTILE[name][0](file.create_group("g"))
    code, said = imported(f"a.{suffix}", "g/angle_x" if suffix == "h5" else "g.angle_x")
    # a group, or a group that contains itself, is no variable; all else is refused for what it is
    expected = "has no variable" if name in ("cycle", "group") else HOSTILE[name][1]
    assert code == 4 and expected in said


def test_a_way_through_a_group_that_contains_itself_ends(tmp_path, imported):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["g"] = file["/"]
        file["x"] = np.arange(10.0)
    assert imported("a.h5", "g/" * 300 + "x")[0] == 0  # as long as somebody writes it, and no longer


def element(kind: int, data: bytes) -> bytes:
    """An element of a MATLAB 5 file, padded to 8 bytes."""
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def matlab_bomb(path: Path, gib: float) -> None:
    """A structure of one element, whose field unpacks to so many zeros: only reading it tells how large it is."""
    count = int(gib * 2**30) // 2**23 * 2**20  # of doubles, in pieces of 8 MiB
    flags, name = struct.pack("<II", 2, 0), element(1, b"s")
    inner = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<ii", 1, count)) + element(1, b"")
    field = struct.pack("<II", 14, len(inner) + 8 + 8 * count) + inner + struct.pack("<II", 9, 8 * count)
    head = element(6, flags) + element(5, struct.pack("<ii", 1, 1)) + name
    head += element(5, struct.pack("<i", 8)) + element(1, b"x".ljust(8, b"\0")) + field
    content = struct.pack("<II", 14, len(head) + 8 * count) + head
    packer, piece = zlib.compressobj(9), bytes(2**23)
    start = packer.compress(content) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(piece) + packer.flush(zlib.Z_FULL_FLUSH)  # the same bytes for every further piece
    check = zlib.adler32(content)
    for _ in range(8 * count // 2**23):
        check = zlib.adler32(piece, check)
    body = start + again * (8 * count // 2**23) + b"\x03\x00" + struct.pack(">I", check)
    header = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(header + struct.pack("<II", 15, len(body)) + body)


@pytest.mark.usefixtures("started_readers")
def test_a_small_matlab_structure_of_that_make_is_read(tmp_path):
    """The bomb is a sound file: with few zeros, scipy unpacks all of them."""
    matlab_bomb(tmp_path / "a.mat", 2**-6)
    assert scipy.io.whosmat(tmp_path / "a.mat") == [("s", (1, 1), "struct")]
    found = scipy.io.loadmat(tmp_path / "a.mat")["s"]["x"][0, 0]
    assert found.shape == (1, 2**21) and not found.any()


@pytest.mark.usefixtures("started_readers")
def test_a_matlab_structure_that_unpacks_to_gibibytes_stays_within_the_bound(tmp_path, imported):
    matlab_bomb(tmp_path / "a.mat", 3.0)
    assert (tmp_path / "a.mat").stat().st_size < 4 * 2**20
    code, said = imported("a.mat", "s.x")
    assert code == 4 and "takes more memory to read than its size allows" in said
    # 1 GiB, 100 times 3.2 MB, and what Python and its libraries have before: less than what the bomb would take
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 < 2.5 * 2**30


@pytest.mark.usefixtures("started_readers")
@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import os; os.abort()", "crashes its reader (exit -6)"),
        ("import sys; sys.stdin.readline(); print('{', flush=True)", "crashes its reader (exit 0)"),
        ('import sys; sys.stdin.readline(); print(\'{"names": ["x"]}\', flush=True)', "crashes its reader (exit 0)"),
        ("while True: pass", "keeps its reader busy for more than 1 s of processor time"),
    ],
    ids=["crash", "half an answer", "crash at the array", "hang"],
)
def test_a_reader_that_does_not_survive_is_a_clear_error(tmp_path, imported, monkeypatch, code, said):
    (tmp_path / "a.h5").write_bytes(b"x")
    monkeypatch.setattr(isolated, "CHILD", f"print('ready', flush=True)\n{code}")
    monkeypatch.setattr(isolated, "time_limit_s", lambda _path: 1.0)
    before_s = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    exit_code, told = imported("a.h5")
    assert exit_code == 4 and f"a.h5 is damaged and {said}: restore it" in told
    # processor time of readers that have ended: the clock says what else the machine does
    assert resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before_s < 10.0


@pytest.mark.usefixtures("started_readers")
def test_a_reader_that_is_kept_waiting_is_no_fault_of_the_file(tmp_path, imported, monkeypatch):
    """It computes nothing, so it has its time; a machine that serves others must not damage a sound file."""
    (tmp_path / "a.h5").write_bytes(b"x")
    monkeypatch.setattr(isolated, "CHILD", "print('ready', flush=True); import time; time.sleep(600)")
    monkeypatch.setattr(isolated, "time_limit_s", lambda _path: 0.1)
    monkeypatch.setattr(child, "WAIT_S", 0.5)
    exit_code, told = imported("a.h5")
    assert exit_code == 4 and "took too long" in told and "busy, try again" in told and "damaged" not in told


@pytest.mark.usefixtures("started_readers")
def test_a_reader_has_its_time_however_slowly_the_clock_lets_it_compute(tmp_path, imported, monkeypatch):
    """Three times its limit pass on the clock while it waits; it then answers."""
    (tmp_path / "a.h5").write_bytes(b"x")
    answer = "for line in sys.stdin: time.sleep(1.0); print('{\"names\": []}', flush=True)"
    monkeypatch.setattr(isolated, "CHILD", f"import sys, time; print('ready', flush=True)\n{answer}")
    monkeypatch.setattr(isolated, "time_limit_s", lambda _path: 0.5)
    assert "has no variable 'x'" in imported("a.h5")[1]


@pytest.mark.parametrize("suffix", ["h5", "mat", "73.mat"])
def test_mutated_sources_are_imported_or_refused(tmp_path, imported, suffix):
    values = np.random.default_rng(3).normal(size=200)
    path = tmp_path / f"sound.{suffix}"
    if suffix == "mat":
        scipy.io.savemat(path, {"x": values, "s": {"y": values}}, do_compression=True)
    else:
        with h5py.File(path, "w") as file:
            file.create_dataset("x", data=values, chunks=(64,), compression=4, fletcher32=True)
    content = path.read_bytes()
    assert imported(path.name)[0] == 0
    codes = []
    for seed in range(6):
        damaged = tmp_path / f"a{seed}.{suffix}"
        damaged.write_bytes(mutated(content, seed))
        codes.append(imported(damaged.name)[0])
    assert set(codes) <= {0, 4} and 4 in codes


def test_a_map_of_many_files_keeps_few_processes(tmp_path, imported, monkeypatch):
    living: list[int] = []
    started = isolated.start_python  # type: ignore[attr-defined]  # what the fixture has put there

    def counted(*arguments, **options):
        living.append(sum(child.poll() is None for child in children) + 1)
        children.append(started(*arguments, **options))
        return children[-1]

    children: list[subprocess.Popen[bytes]] = []
    monkeypatch.setattr(isolated, "start_python", counted)
    parts = ""
    for index in range(12):
        with h5py.File(tmp_path / f"p{index}.h5", "w") as file:
            file["x"] = np.arange(5.0) + index
        parts += f'[[parts]]\nlabel = "{index}"\nsource = "p{index}.h5"\n'
    (tmp_path / "map.toml").write_text(MAP.format(source="p0.h5", select="x") + parts)
    assert main(["import", "map.toml", "-o", "all.h5"]) == 0
    assert (len(living), max(living)) == (12, 8)
    assert all(child.poll() is not None for child in children)
    with h5py.File(tmp_path / "all.h5") as file:
        np.testing.assert_array_equal(file["channels/x"], np.add.outer(np.arange(12.0), np.arange(5.0)).ravel())
