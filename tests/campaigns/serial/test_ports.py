"""The lasting name of a pseudo-terminal: it replaces nothing but such a name, and takes away nothing but its own."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from campaigns.serial.ports import PtyPort
from sim_backend.errors import ConfigError
from tests import running

THINGS = {
    "file": lambda path: path.write_bytes(b"precious"),
    "folder": lambda path: path.mkdir(),
    "pipe": os.mkfifo,
    "link to a file": lambda path: path.symlink_to(__file__),
    "link to a device": lambda path: path.symlink_to("/dev/null"),
    "link to nothing": lambda path: path.symlink_to("not-there"),
}


def found(path: Path) -> tuple[int, str, bytes]:
    """Return what is at a path, to compare."""
    mode = path.lstat().st_mode
    return mode, os.readlink(path) if path.is_symlink() else "", path.read_bytes() if path.is_file() else b""


@pytest.mark.parametrize("thing", THINGS)
def test_what_is_there_stays(tmp_path: Path, thing: str) -> None:
    path = tmp_path / "bench"
    THINGS[thing](path)
    before = found(path)
    done = subprocess.run(
        [*running.MCCD, "bench", "serve", "--link", str(path)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2 and "exists and is not a symbolic link to a terminal" in done.stderr
    assert found(path) == before and list(tmp_path.iterdir()) == [path]


def test_what_a_killed_bench_has_left_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "bench"
    path.symlink_to("/dev/pts/999999")
    port = PtyPort(path)
    line = port.accept()
    assert line is not None and path.exists() and os.readlink(path) != "/dev/pts/999999"
    line.close()
    port.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("thing", THINGS)
def test_what_somebody_put_there_meanwhile_stays(tmp_path: Path, thing: str) -> None:
    path = tmp_path / "bench"
    port = PtyPort(path)
    line = port.accept()
    assert line is not None
    path.unlink()
    THINGS[thing](path)
    before = found(path)
    line.close()
    assert found(path) == before
    with pytest.raises(ConfigError, match="choose another name"):
        port.accept()
    port.close()
    assert found(path) == before


def test_a_second_bench_that_took_the_name_keeps_it(tmp_path: Path) -> None:
    path = tmp_path / "bench"
    first, second = PtyPort(path), PtyPort(path)
    lines = [first.accept(), second.accept()]
    name = os.readlink(path)
    assert lines[0] is not None and lines[1] is not None
    lines[0].close()
    first.close()
    assert os.readlink(path) == name
    lines[1].close()
    second.close()
    assert not path.is_symlink()


@pytest.mark.parametrize("link", [".", "/", "..", "not-there/bench", "x" * 300, ""])
def test_names_that_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, link: str) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="choose a"):
        PtyPort(Path(link)).accept()


def test_no_folder_for_the_name(tmp_path: Path) -> None:
    nowhere = {"TMPDIR": str(tmp_path / "not-there"), "TEMP": "", "TMP": ""}
    script = (
        "import tempfile; tempfile._candidate_tempdir_list = lambda: ['/not-there']\n"  # as where all is read-only
        "from mccdcli.main import main; raise SystemExit(main(['bench', 'serve']))"
    )
    done = running.mccd("-c", script, env=nowhere, command=running.PYTHON, cwd=tmp_path)
    assert done.returncode == 2 and "set TMPDIR or --link" in done.stderr and "Traceback" not in done.stderr


def test_the_name_comes_back_after_a_dropped_line(tmp_path: Path) -> None:
    path = tmp_path / "bench"
    port = PtyPort(path)
    for _ in range(2):
        line = port.accept()
        assert line is not None and path.is_char_device() and port.accept() is None
        line.close()
        assert not path.is_symlink()
    port.close()
