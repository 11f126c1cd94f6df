"""One command, run by the server: hands over its words and streams, passes signals on, ends as the command ends.

Started as a script without site-packages: only what the standard library has. The first client starts the server.
"""

import array
import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

SOCKET = "MCCD_TEST_SERVER"  # variables: the path of the server's socket, and whose end is its end
OWNER = "MCCD_TEST_OWNER"


def main() -> int:
    early: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda got, _: early.append(got))
    with connected(os.environ[SOCKET]) as connection:
        words = json.dumps({"arguments": sys.argv[1:], "cwd": os.getcwd(), "environ": dict(os.environ)}).encode()
        streams = array.array("i", [0, 1, 2])
        connection.sendmsg([len(words).to_bytes(8, "big")], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, streams)])
        connection.sendall(words)
        answers = connection.makefile("r", encoding="ascii")
        pid = int(answers.readline())
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, lambda got, _: os.kill(pid, got))
        for got in early:
            os.kill(pid, got)
        code = int(answers.readline())
    if code < 0:  # it died of a signal, and so do we
        if -code != signal.SIGKILL:
            signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    return code


def connected(path: str) -> socket.socket:
    """Return a connection to the server, which is started if it is not there."""
    connection = socket.socket(socket.AF_UNIX)
    if not Path(path).exists():
        with open(f"{path}.lock", "w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not Path(path).exists():
                start(path)
    connection.connect(path)
    return connection


def start(path: str) -> None:
    """Start the server and wait until it listens; what it says otherwise is in a file beside its socket."""
    command = [sys.executable, "-m", "tests.running.server", path, os.environ[OWNER]]
    with open(f"{path}.log", "wb") as said:
        server = subprocess.Popen(
            command,
            cwd=Path(__file__).parents[2],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=said,
            start_new_session=True,
        )
    if server.stdout is None or server.stdout.readline() != b"ready\n":
        sys.exit(f"the server of commands has not started: {Path(f'{path}.log').read_text()}")


if __name__ == "__main__":
    sys.exit(main())
