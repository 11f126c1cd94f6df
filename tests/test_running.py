"""A command that a test forks from the server is one that a user starts: words, folder, variables, streams, end."""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.running import MCCD, PYTHON, REAL, mccd, unmeasured
from tests.running.client import SOCKET, connected

TOLD = "import json, os, sys; print(json.dumps([sys.argv, os.getcwd(), os.environ['TOLD'], sys.stdin.read()]))"


def test_a_fork_has_the_words_folder_variables_and_streams_of_its_client(tmp_path: Path) -> None:
    command = [*PYTHON, "-c", TOLD, "a b", "ü"]
    done = subprocess.run(
        command, cwd=tmp_path, env=os.environ | {"TOLD": "x=1"}, input="typed", capture_output=True, text=True
    )
    assert json.loads(done.stdout) == [["-c", "a b", "ü"], str(tmp_path), "x=1", "typed"], done.stderr


@pytest.mark.parametrize(
    "arguments",
    [["--version"], ["bench", "list", "--json"], ["log", "show", "no-such-file.h5"], ["chop", "--alpha", "north"], []],
    ids=" ".join,
)
def test_a_forked_command_says_what_a_real_one_says(arguments: Sequence[str], tmp_path: Path) -> None:
    forked, real = (mccd(*arguments, cwd=tmp_path, command=command) for command in (MCCD, REAL))
    assert (forked.returncode, forked.stdout) == (real.returncode, real.stdout)
    assert forked.stderr == real.stderr


@pytest.mark.parametrize(
    ("code", "end"),
    [
        ("raise SystemExit(3)", 3),
        ("raise SystemExit('words')", 1),
        ("1 / 0", 1),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", -signal.SIGKILL),
        ("import atexit; atexit.register(print, 'last')", 0),
    ],
)
def test_a_fork_ends_as_the_interpreter_does(code: str, end: int) -> None:
    done = subprocess.run([*PYTHON, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.returncode == end, done.stderr
    assert done.stdout == ("last\n" if "last" in code else "")
    assert {3: "", -signal.SIGKILL: "", 0: ""}.get(end, done.stderr) == done.stderr
    assert "words" not in code or done.stderr == "words\n"


def test_signals_reach_a_fork_and_a_client_that_is_killed_takes_it_along() -> None:
    code = "import os, time; print(os.getpid(), flush=True); time.sleep(60)"
    with subprocess.Popen([*PYTHON, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as told:
        assert told.stdout is not None and told.stderr is not None
        told.stdout.readline()
        told.send_signal(signal.SIGINT)
        assert told.wait(timeout=20) == -signal.SIGINT and "KeyboardInterrupt" in told.stderr.read()
    with subprocess.Popen([*PYTHON, "-c", code], stdout=subprocess.PIPE, text=True) as gone:
        assert gone.stdout is not None
        fork = os.pidfd_open(int(gone.stdout.readline()))
        gone.kill()
        assert gone.wait(timeout=20) == -signal.SIGKILL
        assert select.select([fork], [], [], 20.0)[0], "the fork has outlived its client"
        os.close(fork)


def test_a_command_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    number = tmp_path / "number"
    code = f"import os, time; open({str(number)!r}, 'w').write(str(os.getpid())); time.sleep(60)"
    with pytest.raises(subprocess.TimeoutExpired):
        mccd("-c", code, command=PYTHON, timeout=2.0)
    try:
        fork = os.pidfd_open(int(number.read_text()))
    except ProcessLookupError:
        return  # it has ended already
    assert select.select([fork], [], [], 20.0)[0], "it goes on"
    os.close(fork)


def test_clients_that_go_away_at_any_moment_leave_the_server_to_the_others() -> None:
    words = json.dumps({"arguments": ["-c", ""], "cwd": os.getcwd(), "environ": dict(os.environ)}).encode()
    head, streams = len(words).to_bytes(8, "big"), [0, 1, 2]
    for sent in (b"", head, head + words[:9], *[head + words] * 40):  # so many that several are gone before their turn
        with connected(os.environ[SOCKET]) as connection:
            if sent:
                socket.send_fds(connection, [sent[:8]], streams)
                connection.sendall(sent[8:])
    done = subprocess.run([*PYTHON, "-c", "print('here')"], capture_output=True, text=True, timeout=60)
    assert done.stdout == "here\n", done.stderr


def test_a_process_whose_writing_is_watched_leaves_no_counts_of_coverage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("coverage", reason="comes with the extra dev")
    (tmp_path / "settings").write_text(f"[run]\ndata_file = {tmp_path}/counts\n")
    monkeypatch.delenv("COVERAGE_PROCESS_CONFIG", raising=False)
    monkeypatch.setenv("COVERAGE_PROCESS_START", str(tmp_path / "settings"))
    command = [sys.executable, "-c", "import json"]
    subprocess.run(command, env=unmeasured(), check=True, timeout=60)
    assert not list(tmp_path.glob("counts*"))
    subprocess.run(command, env=os.environ, check=True, timeout=60)
    assert list(tmp_path.glob("counts*")), "else the first run says nothing"
