"""One command, run by the server: hands over its words and streams, passes signals on, ends as the command ends.

Started as a script without site-packages, so with the standard library alone, and as little of that as it takes.
The first client starts the server.
"""

import array
import json
import os
import signal
import socket
import sys

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
    if not os.path.exists(path):
        start(path)
    connection.connect(path)
    return connection


def start(path: str) -> None:
    """Start the server, unless another process does, and wait until it listens.

    What it says beyond that is in a file beside its socket. Raises RuntimeError when it does not start.
    """
    import fcntl  # all other clients do without these, whose import takes as long as all else they do
    import subprocess
    from pathlib import Path

    with open(f"{path}.lock", "w") as lock, open(f"{path}.log", "ab") as said:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if os.path.exists(path):
            return
        server = subprocess.Popen(
            [sys.executable, "-m", "tests.running.server", path, os.environ[OWNER]],
            cwd=Path(__file__).parents[2],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=said,
            start_new_session=True,
        )
        if server.stdout is None or server.stdout.readline() != b"ready\n":
            raise RuntimeError(f"the server of commands has not started: {Path(f'{path}.log').read_text()}")


if __name__ == "__main__":
    sys.exit(main())
