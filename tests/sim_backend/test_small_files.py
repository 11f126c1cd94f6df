"""Small files are read within their limit, and at once where they are no ordinary files."""

from __future__ import annotations

import os
import socket

import pytest

from sim_backend.documents import read_text
from sim_backend.errors import ConfigError
from sim_backend.model import load_model
from sim_backend.safe_write import open_lock
from sim_backend.small_files import read_small, read_small_text


@pytest.fixture(params=["pipe", "endless", "folder", "socket"])
def no_file(request, tmp_path, monkeypatch):
    """The path of something that is no ordinary file; to open a pipe or to read all of a device would never end."""
    monkeypatch.chdir(tmp_path)  # the path of a socket must be short
    path = tmp_path / "a"
    match request.param:
        case "pipe":
            os.mkfifo(path)
        case "endless":
            path.symlink_to("/dev/zero")
        case "folder":
            path.mkdir()
        case "socket":
            with socket.socket(socket.AF_UNIX) as made:
                made.bind("a")
    return path


def test_what_is_no_ordinary_file_is_refused_at_once(no_file):
    for read in (lambda: read_small(no_file, 100), lambda: read_small_text(no_file, 100)):
        with pytest.raises(OSError, match=r"no ordinary file|No such device|Is a directory"):
            read()
    with pytest.raises(ConfigError, match="a: .*name the file of a model"):
        read_text(no_file, "model")
    with pytest.raises(ConfigError, match="name the file of a model"):
        load_model(no_file)
    with pytest.raises(ConfigError, match="a lock"):
        open_lock(no_file)


def test_a_file_is_read_up_to_its_limit_and_no_further(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"x" * 100)
    assert read_small(path, 100) == b"x" * 100
    with pytest.raises(OSError, match="more than 99 bytes"):
        read_small(path, 99)
    os.truncate(path, 2**40)  # a hole; as a whole it would not fit into any memory
    with pytest.raises(OSError, match="more than 100 bytes"):
        read_small(path, 100)


def test_a_file_that_grows_beyond_what_its_folder_says_is_no_larger_for_that():
    """Files of the system say that they are empty."""
    assert len(read_small("/proc/self/status", 10_000)) > 0
    with pytest.raises(OSError, match="more than 10 bytes"):
        read_small("/proc/self/status", 10)


def test_text_has_the_line_feeds_of_python(tmp_path):
    (tmp_path / "a").write_bytes("é\r\nb\rc\n".encode())
    assert read_small_text(tmp_path / "a", 100) == "é\nb\nc\n"
    (tmp_path / "a").write_bytes(b"\xff")
    with pytest.raises(ConfigError, match="not UTF-8 text at byte 0"):
        read_text(tmp_path / "a", "map")
