"""What is kept of compiled code is given back whole or not at all, whatever has become of its file."""

from __future__ import annotations

import os
import subprocess
import sys
import time
import warnings
from pathlib import Path

import pytest

from sim_backend import kernel_cache
from sim_backend.kernel_cache import KEPT_DAYS, VARIABLE, KernelCacheWarning, keep_entry, read_entry

DATA = bytes(range(256)) * 3


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache, and a process that has not warned yet."""
    monkeypatch.setenv(VARIABLE, str(tmp_path / "kernels"))
    monkeypatch.setattr(kernel_cache, "_told", set())
    return tmp_path / "kernels"


def test_an_entry_is_read_by_another_process(folder: Path) -> None:
    keep_entry("loop-1", DATA)
    script = (
        "import sys; from sim_backend.kernel_cache import read_entry; sys.stdout.buffer.write(read_entry('loop-1'))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True, timeout=60)
    assert done.stdout == DATA
    assert folder.stat().st_mode & 0o077 == 0
    assert read_entry("loop-2") is None


def test_no_flipped_bit_passes(folder: Path) -> None:
    keep_entry("loop-1", DATA)
    whole = (folder / "loop-1").read_bytes()
    for at in range(8 * len(whole)):
        byte, bit = divmod(at, 8)
        (folder / "loop-1").write_bytes(whole[:byte] + bytes([whole[byte] ^ 1 << bit]) + whole[byte + 1 :])
        kernel_cache._told.add("before")  # noqa: SLF001 so that only the first one is a warning
        assert read_entry("loop-1") is None, at


@pytest.mark.parametrize("length", [0, 1, 31, 32, 33, 799])
def test_no_part_of_an_entry_passes(folder: Path, length: int) -> None:
    keep_entry("loop-1", DATA)
    whole = (folder / "loop-1").read_bytes()
    (folder / "loop-1").write_bytes(whole[:length])
    with pytest.warns(KernelCacheWarning, match="loop-1 is damaged"):
        assert read_entry("loop-1") is None
    keep_entry("loop-1", DATA)
    assert read_entry("loop-1") == DATA


def test_an_entry_under_another_name_is_damage(folder: Path) -> None:
    keep_entry("loop-1", DATA)
    (folder / "loop-1").rename(folder / "loop-2")
    with pytest.warns(KernelCacheWarning, match="loop-2 is damaged"):
        assert read_entry("loop-2") is None


def _link(path: Path) -> None:
    path.with_name("elsewhere").write_bytes(b"")
    path.symlink_to("elsewhere")


def _endless(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(kernel_cache.MOST_BYTES + 1)


def _by_all(path: Path) -> None:
    path.write_bytes(b"")
    path.chmod(0o666)


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir, _link, _endless, _by_all], ids=lambda make: make.__name__)
def test_what_is_no_file_of_ours_is_neither_waited_for_nor_used(folder: Path, make) -> None:
    keep_entry("other", DATA)
    make(folder / "loop-1")
    with pytest.warns(KernelCacheWarning, match="loop-1 cannot be read"):
        assert read_entry("loop-1") is None


@pytest.mark.parametrize("mode", [0o777, 0o770, 0o707])
def test_a_folder_that_others_may_write_is_not_used(folder: Path, mode: int) -> None:
    folder.mkdir()
    folder.chmod(mode)
    with pytest.warns(KernelCacheWarning, match="may be written by other users"):
        keep_entry("loop-1", DATA)
    assert read_entry("loop-1") is None
    assert list(folder.iterdir()) == []


def test_where_nothing_can_be_kept_it_is_said_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_bytes(b"")
    monkeypatch.setenv(VARIABLE, str(tmp_path / "file" / "kernels"))
    with pytest.warns(KernelCacheWarning, match=f"set {VARIABLE} to a folder of your own") as said:
        for _ in range(3):
            keep_entry("loop-1", DATA)
            assert read_entry("loop-1") is None
    assert len(said) == 1


def test_a_full_disk_leaves_no_part_of_an_entry(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    keep_entry("other", DATA)
    monkeypatch.setattr(kernel_cache, "_digest", lambda name, data: b"x" * 2**20)
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(
        resource.RLIMIT_FSIZE, (4096, before[1])
    )  # as a full disk does, it ends in the middle of a write
    try:
        with pytest.warns(KernelCacheWarning, match="cannot be written"):
            keep_entry("loop-1", DATA)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert [entry.name for entry in folder.iterdir()] == ["other"]


def test_entries_of_long_ago_are_removed_and_nothing_else(folder: Path) -> None:
    """A chosen folder may hold other files, however old."""
    old, new = f"loop-{'0' * 32}", f"add_products-{'1' * 32}"
    for name in (old, new):
        keep_entry(name, DATA)
    others = ["thesis.tex", "loop-1", f"notes-{'0' * 33}", ".profile"]
    for name in others:
        (folder / name).write_bytes(b"mine")
    killed = f".{old}.{'a' * 16}.tmp"
    (folder / killed).write_bytes(b"a writer was killed")
    long_ago = time.time() - (KEPT_DAYS + 1) * 86_400
    for name in (old, killed, *others):
        os.utime(folder / name, (long_ago, long_ago))
    kernel_cache._checked.cache_clear()  # noqa: SLF001 as in a new process
    assert read_entry(new) == DATA
    assert {entry.name for entry in folder.iterdir()} == {new, *others}


def test_a_user_without_a_home_has_no_cache_and_no_crash(tmp_path: Path) -> None:
    script = (
        "from sim_backend.kernel_cache import keep_entry, read_entry; keep_entry('a', b'b'); print(read_entry('a'))"
    )
    nobody = {k: v for k, v in os.environ.items() if k not in ("HOME", "XDG_CACHE_HOME", VARIABLE)}
    done = subprocess.run(
        ["setpriv", "--reuid=54321", "--clear-groups", sys.executable, "-c", script]
        if os.geteuid() == 0
        else [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        timeout=60,
        env=nobody,
    )
    assert done.stdout.strip() in ("None", "b'b'"), done.stderr


@pytest.mark.parametrize(("mode", "used"), [(0o777, False), (0o770, False), (0o1777, True), (0o755, True)])
def test_a_folder_that_others_may_exchange_is_not_used(folder: Path, mode: int, used: bool) -> None:
    above = folder.parent / "above"
    above.mkdir()
    above.chmod(mode)
    os.environ[VARIABLE] = str(above / "kernels")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        keep_entry("loop-1", DATA)
    assert (read_entry("loop-1") == DATA) is used
    assert [str(w.message).partition(";")[0] for w in said] == (
        [] if used else [f"kernel cache: {above} may be written by other users"]
    )


def test_a_user_without_a_home_leaves_nothing_where_he_works(tmp_path: Path) -> None:
    script = (
        "import os, pwd\n"
        "def nobody(uid): raise KeyError(uid)\n"
        "pwd.getpwuid = nobody\n"
        "from sim_backend.kernel_cache import keep_entry, read_entry\n"
        "keep_entry('a', b'b'); print(read_entry('a'))"
    )
    nobody = {k: v for k, v in os.environ.items() if k not in ("HOME", "XDG_CACHE_HOME", VARIABLE)}
    nobody["PYTHONPATH"] = str(Path(__file__).parents[2])
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, env=nobody, cwd=tmp_path
    )
    assert done.stdout.strip() == "None", done.stderr
    assert "no folder to keep compiled code in" in done.stderr
    assert list(tmp_path.iterdir()) == []
