"""Children that are forked instead of started, so that a soak tries thousands of files in the time of hundreds."""

from __future__ import annotations

import os
import subprocess
import sys

HIGHEST_FILE = 256


def forked(code: str, *arguments: str, talk: bool = False) -> subprocess.Popen[bytes]:
    """Do what `campaigns.log.child.start_python` does, in a copy of this process that has everything imported."""

    def run() -> None:
        os.closerange(3, HIGHEST_FILE)  # among them the pipe by which Popen would wait for the program to start
        sys.argv = ["-c", *arguments]
        sys.stdin, sys.stdout = open(0, closefd=False), open(1, "w", closefd=False)
        status = 1
        try:
            exec(code, {})
            sys.stdout.flush()
            status = 0
        finally:
            os._exit(status)

    return subprocess.Popen(
        [sys.executable],
        stdin=subprocess.PIPE if talk else subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        preexec_fn=run,  # which never returns
    )
