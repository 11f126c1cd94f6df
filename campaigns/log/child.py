"""A Python process of our own with bounded memory, for what may crash, hang or exhaust whoever reads it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

START_S = 10.0
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


def time_limit_s(path: Path) -> float:
    """Return how long a child may take to read the file at `path`; raises OSError when there is none."""
    return START_S + path.stat().st_size / SLOWEST_BYTES_S


def bound_memory(more_bytes: int = 0) -> None:
    """Let this process take 1 GiB and `more_bytes` beyond what it has, and leave no core file when it crashes."""
    try:
        import resource

        mapped = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
        resource.setrlimit(resource.RLIMIT_AS, (mapped + MEMORY_BYTES + more_bytes, resource.RLIM_INFINITY))
    except (ImportError, OSError, ValueError):
        return  # not Linux, or a tighter limit stands already
