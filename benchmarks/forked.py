"""Children that are forked instead of started, so that a soak tries thousands of files in the time of hundreds."""

from __future__ import annotations

import subprocess
import sys

from campaigns.log.child import fork_python


def forked(code: str, *arguments: str, talk: bool = False) -> subprocess.Popen[bytes]:
    """Do what `campaigns.log.child.start_python` does, in a copy of this process that has everything imported."""

    def work() -> None:
        sys.argv = ["-c", *arguments]
        exec(code, {})

    process = fork_python(work)
    if not talk and process.stdin is not None:
        process.stdin.close()
        process.stdin = None
    return process
