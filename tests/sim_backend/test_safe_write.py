"""Files appear whole, where they were named, whatever stands there and however writing ends."""

from __future__ import annotations

import os
import signal
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from sim_backend.errors import ConfigError
from sim_backend.safe_write import (
    folder_within,
    open_lock,
    require_no_link,
    whole_file,
    whole_path,
    whole_text_file,
    write_bytes,
    write_text,
)
from tests.running import unmeasured


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    """A file outside the folder that is written into, to which links lead."""
    path = tmp_path / "victim"
    path.write_text("precious")
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "folder"
    path.mkdir()
    return path


def test_a_link_is_replaced_and_never_followed(folder, victim):
    for name, target in (("linked", victim), ("dangling", victim.with_name("nothing"))):
        (folder / name).symlink_to(target)
        write_text(folder / name, "new")
        assert not (folder / name).is_symlink()
        assert (folder / name).read_text() == "new"
    assert victim.read_text() == "precious"
    assert not victim.with_name("nothing").exists()
    assert sorted(os.listdir(folder)) == ["dangling", "linked"]


def test_permissions_are_those_of_the_umask_and_of_the_mode(folder):
    before = os.umask(0o027)
    try:
        write_text(folder / "open", "")
        write_bytes(folder / "own", b"", mode=0o600)
    finally:
        os.umask(before)
    assert [stat.S_IMODE((folder / name).stat().st_mode) for name in ("open", "own")] == [0o640, 0o600]


def test_a_failure_keeps_the_old_file_and_leaves_no_other(folder):
    write_text(folder / "kept", "old")
    for writing in (whole_file, whole_text_file, whole_path):
        with pytest.raises(KeyError), writing(folder / "kept") as new:
            if isinstance(new, Path):
                new.write_text("half")
            raise KeyError
    assert (folder / "kept").read_text() == "old"
    assert os.listdir(folder) == ["kept"]


def test_what_may_not_be_replaced_is_told(folder, victim):
    (folder / "taken").symlink_to(victim)
    with pytest.raises(ConfigError, match="exists and is not overwritten"), whole_file(folder / "taken", replace=False):
        pass
    with whole_path(folder / "free", replace=False) as hidden:
        hidden.write_text("new")
        assert hidden.parent == folder and hidden.name != "free"
    assert (folder / "free").read_text() == "new"
    assert sorted(os.listdir(folder)) == ["free", "taken"]


def test_two_hidden_names_differ_and_long_names_fit(folder):
    name = "θ" * 127  # 254 bytes, of at most 255
    with whole_file(folder / name) as first, whole_file(folder / name) as second:
        first.write(b"1")
        second.write(b"2")
        assert len(os.listdir(folder)) == 2
    assert os.listdir(folder) == [name]


@pytest.mark.parametrize("special", ["/dev/full", "/dev/stdout", "folder", "pipe"])
def test_only_a_file_can_be_replaced(folder, special):
    (folder / "folder").mkdir()
    os.mkfifo(folder / "pipe")
    with pytest.raises(ConfigError, match="name a new file in an ordinary folder"):
        write_text(folder / special, "x")
    assert not os.path.isfile(os.path.realpath("/dev/full"))


def test_a_name_that_is_no_text_is_told(folder):
    with pytest.raises(ConfigError, match="UTF-8"):
        write_text(Path(os.fsdecode(os.fsencode(folder) + b"/x\xff")), "x")


def test_a_full_disk_is_told_with_the_name_that_the_user_gave(folder):
    script = f"""
import resource, signal
from pathlib import Path
from sim_backend.safe_write import whole_text_file
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    with whole_text_file(Path({str(folder / "big")!r})) as file:
        for _ in range(1000):
            file.write("x" * 100)
except OSError as error:
    print(error.filename)
"""
    command = [sys.executable, "-W", "error", "-c", script]
    done = subprocess.run(command, env=unmeasured(), capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == (f"{folder / 'big'}\n", "")
    assert os.listdir(folder) == []


def test_a_kill_leaves_the_old_file(folder):
    write_text(folder / "kept", "old")
    script = f"""
from pathlib import Path
from sim_backend.safe_write import whole_file
with whole_file(Path({str(folder / "kept")!r})) as file:
    file.write(b"half")
    file.flush()
    print("written", flush=True)
    input()
"""
    with subprocess.Popen(
        [sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "written\n"
        process.send_signal(signal.SIGKILL)
    assert (folder / "kept").read_text() == "old"


def test_a_lock_is_an_ordinary_file_and_keeps_what_it_holds(folder, victim):
    (folder / "lock").symlink_to(victim)
    with pytest.raises(ConfigError, match="is a link"):
        open_lock(folder / "lock")
    os.mkfifo(folder / "pipe")
    with pytest.raises(ConfigError, match="not an ordinary file"):
        open_lock(folder / "pipe")
    assert victim.read_text() == "precious"
    open_lock(victim).close()
    assert victim.read_text() == "precious"
    open_lock(folder / "new").close()
    assert (folder / "new").read_text() == ""


def test_a_folder_of_results_is_no_link(folder, tmp_path):
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (folder / "figures").symlink_to(elsewhere)
    (folder / "file").touch()
    for name in ("figures", "file"):
        with pytest.raises(ConfigError, match="is a link or a file"):
            folder_within(folder, name)
    assert folder_within(folder / "made", "too").is_dir()
    with pytest.raises(ConfigError, match="is a link"):
        require_no_link(folder / "figures")
