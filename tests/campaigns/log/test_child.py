"""Processes of our own run our code alone, wherever they are started."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from campaigns.log.child import LEAST_S, Limited, start_python, time_limit_s

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize(
    "words",
    [
        ("log", "show", "run.h5"),
        ("import", "map.toml", "-o", "out.h5"),
        ("rest", "--bench", "emulator", "--set", "duration_s=0.01", "--set", "settle_s=0.01", "-o", "rest.h5"),
    ],
    ids=lambda words: words[0],
)
def test_a_module_in_the_current_folder_is_not_run(tmp_path: Path, words: tuple[str, ...]) -> None:
    """A folder of data that somebody else has filled may hold a `numpy.py`."""
    here, ran = tmp_path / "here", tmp_path / "ran"
    here.mkdir()
    for name in ("h5py", "numpy", "json", "msgspec", "campaigns"):
        (here / f"{name}.py").write_text(f"open({str(ran)!r}, 'a').write(__name__)\nraise ImportError\n")
    (here / "run.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    (here / "a.npy").write_bytes(b"\x93NUMPY")
    (here / "map.toml").write_text(
        '[log]\nsource = "a.npy"\nsample_rate_hz = 1\ntest = "t"\n'
        '[channels.x]\nselect = "x"\nrole = "input"\ndof = "x"\nunit = "1"\n'
    )
    done = subprocess.run(
        [sys.executable, "-P", "-m", "mccdcli", *words],
        cwd=here,
        capture_output=True,
        text=True,
        timeout=120,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )
    assert not ran.exists(), ran.read_text()
    assert done.returncode in (0, 2, 4), done.stderr
    assert "did not start" not in done.stderr


def test_a_hole_in_a_file_gives_its_reader_no_more_time(tmp_path: Path) -> None:
    path = tmp_path / "holes.mat"
    path.write_bytes(b"MATLAB")
    os.truncate(path, 5 * 2**30)
    assert time_limit_s(path) < LEAST_S + 1.0


def test_an_interrupt_as_a_child_is_asked_leaves_nothing_that_keeps_this_process_from_ending(monkeypatch) -> None:
    """Ctrl-C may come when the timer of the child's time limit has started and nobody is there yet to stop it."""
    start = threading.Timer.start

    def interrupted(timer: threading.Timer) -> None:
        start(timer)
        raise KeyboardInterrupt

    monkeypatch.setattr(threading.Timer, "start", interrupted)
    before = set(threading.enumerate())
    reader = Limited(start_python("input()", talk=True))
    with pytest.raises(KeyboardInterrupt), reader.within(LEAST_S):
        pass
    with pytest.raises(KeyboardInterrupt):
        reader.await_ready(Path("run.h5"))
    reader.close()
    for thread in set(threading.enumerate()) - before:
        thread.join(10.0)
        assert not thread.is_alive()
