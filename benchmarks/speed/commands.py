"""What the benchmarks of whole commands share: a child process on two cores, with the most memory that it held."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.speed.base import Round, Target

CORES = 2
"""Cores that a command may use: what its targets are for."""

_WATCHED = """
import os, subprocess, sys
cores, told, *arguments = sys.argv[1:]
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: int(cores)])
code = subprocess.call([sys.executable, *arguments])
try:
    import resource
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
    open(told, "w").write(str(peak))
except ImportError:
    pass
sys.exit(code)
"""
"""A small process between: the system counts what a parent holds at the fork as a peak of its child."""


@dataclass(frozen=True)
class Ran:
    """How a command ended: its exit code, its standard output, and the most memory it held, in MB of 10⁶ bytes.

    `peak_mb` is None on a system that does not tell it.
    """

    code: int
    out: str
    peak_mb: float | None


@dataclass
class Commands:
    """Runs Python as a child in `folder`; `environment` is set besides this process's own."""

    folder: Path
    environment: Mapping[str, str] = field(default_factory=dict)

    def python(self, *arguments: str) -> Ran:
        """Run Python with these arguments on `CORES` cores; what it writes to standard error is dropped."""
        root = str(Path(__file__).parents[2])
        search = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
        told = self.folder / "peak"
        told.unlink(missing_ok=True)
        ran = subprocess.run(
            [sys.executable, "-S", "-c", _WATCHED, str(CORES), str(told), *arguments],
            cwd=self.folder,
            env=os.environ | {"PYTHONPATH": search, "NO_COLOR": "1"} | dict(self.environment),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            check=False,
        )
        return Ran(ran.returncode, ran.stdout, float(told.read_text()) / 1e6 if told.exists() else None)

    def mccd(self, *arguments: str, may_fail: bool = False) -> Ran:
        """Run `mccd`; raises RuntimeError for an exit code other than 0, or 1 where a verdict `may_fail`."""
        ran = self.python("-m", "mccdcli", *arguments)
        if ran.code not in ((0, 1) if may_fail else (0,)):
            raise RuntimeError(f"mccd {' '.join(arguments)} ended with {ran.code}: {ran.out[-500:]}")
        return ran


def at_most_mb(ours: str, limit: float) -> Target:
    """Return the target that `ours`, whose result is a `Ran`, holds at most `limit` MB at any time."""

    def peak(turn: Round) -> float:
        ran: Ran = turn.results[ours]
        return float("nan") if ran.peak_mb is None else ran.peak_mb

    return Target(f"{ours}: peak memory", limit, "MB", (ours,), peak, at_most=True)
