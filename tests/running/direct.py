"""A command of the server's without a client process: its caller hands over words and pipes, and reads them to the end.

For commands that a test only waits for. A test that signals a command, or wants a process of its own to hold, starts
the client.
"""

from __future__ import annotations

import json
import os
import selectors
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from tests.running import client
from tests.running.client import SOCKET


def run_forked(
    words: Sequence[str], *, cwd: Path | None, environ: Mapping[str, str], timeout: float
) -> subprocess.CompletedProcess[str]:
    """Run a forked interpreter with `words` as `subprocess.run` runs one: nothing to read, and both outputs kept.

    Raises subprocess.TimeoutExpired when it takes longer; it has been killed then.
    """
    if not Path(os.environ[SOCKET]).exists():  # a client starts the server, which is nobody's child once that has ended
        subprocess.run([sys.executable, client.__file__, "-c", ""], check=True)
    told = {"arguments": list(words), "cwd": str(cwd or os.getcwd()), "environ": dict(environ)}
    message = json.dumps(told).encode()
    nothing = os.open(os.devnull, os.O_RDONLY)
    (out, out_end), (err, err_end) = os.pipe(), os.pipe()
    with open(out, "rb", buffering=0), open(err, "rb", buffering=0), client.connected(os.environ[SOCKET]) as connection:
        try:
            socket.send_fds(connection, [len(message).to_bytes(8, "big")], [nothing, out_end, err_end])
            connection.sendall(message)
        finally:
            for end in (nothing, out_end, err_end):
                os.close(end)
        # the server kills what it runs when this connection ends
        read = _read([out, err, connection.fileno()], time.monotonic() + timeout)
        if read is None:
            raise subprocess.TimeoutExpired(list(words), timeout)
        *outputs, answers = read
    _, code = answers.split()  # the process's number, and how it ended
    printed, complained = (text.decode().replace("\r\n", "\n").replace("\r", "\n") for text in outputs)
    return subprocess.CompletedProcess(list(words), int(code), printed, complained)


def _read(files: Sequence[int], end_s: float) -> list[bytes] | None:
    """Return all that comes from files until each has ended; None when that takes until `end_s` of the clock."""
    found = {file: bytearray() for file in files}
    with selectors.DefaultSelector() as watched:
        for file in files:
            watched.register(file, selectors.EVENT_READ)
        while watched.get_map():
            ready = watched.select(max(end_s - time.monotonic(), 0.0))
            if not ready:
                return None
            for key, _ in ready:
                part = os.read(key.fd, 2**16)
                found[key.fd] += part
                if not part:
                    watched.unregister(key.fd)
    return [bytes(found[file]) for file in files]
