"""A Python process of our own with bounded memory, for what may crash, hang or exhaust whoever reads it."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

from sim_backend.errors import DataError

START_S = 120.0
"""A cold disk or a busy machine needs long to start Python and import a library; that is no fault of the file."""

LEAST_S = 10.0
SLOWEST_BYTES_S = 5e6
MEMORY_BYTES = 2**30


def start_python(code: str, *arguments: str, talk: bool = False) -> subprocess.Popen[bytes]:
    """Start `code` with this package on its path; its standard output is a pipe, its input too where we `talk`."""
    root = str(Path(__file__).resolve().parents[2])
    search = os.pathsep.join([root, os.environ.get("PYTHONPATH", "")]).rstrip(os.pathsep)
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        stdin=subprocess.PIPE if talk else subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": search},
    )


def tell_ready() -> None:
    """Say in a child, as its first line, that it has started: from then on the time that its file takes counts."""
    sys.stdout.buffer.write(b"ready\n")
    sys.stdout.buffer.flush()


def await_ready(process: subprocess.Popen[bytes], path: Path) -> None:
    """Wait until a child has started that reads the file at `path`; raises DataError when it does not in time."""
    assert process.stdout is not None  # start_python makes it a pipe
    timer = threading.Timer(START_S, process.kill)
    timer.start()
    try:
        if process.stdout.readline() == b"ready\n":
            return
    finally:
        timer.cancel()
    process.wait()
    why = f"within {START_S:.0f} s" if timer.finished.is_set() and process.returncode < 0 else "as it should"
    raise DataError(
        f"the process that reads {path} did not start {why} (exit {process.returncode}); the file is not at fault: "
        "try again when the machine is less busy"
    )


def time_limit_s(path: Path) -> float:
    """Return how long a child that has started may take to read the file at `path`; raises OSError without one."""
    return LEAST_S + path.stat().st_size / SLOWEST_BYTES_S


def bound_memory(more_bytes: int = 0) -> None:
    """Let this process take 1 GiB and `more_bytes` beyond what it has, and leave no core file when it crashes."""
    try:
        import resource

        mapped = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
        resource.setrlimit(resource.RLIMIT_AS, (mapped + MEMORY_BYTES + more_bytes, resource.RLIM_INFINITY))
    except (ImportError, OSError, ValueError):
        return  # not Linux, or a tighter limit stands already
