"""What the benchmarks of whole commands share: a child process on two cores, with the most memory that it held."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.speed.base import Round, Target
from benchmarks.speed.sampled import COMPILED

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
        return _checked(self.python("-m", "mccdcli", *arguments), arguments, may_fail)

    def sampled(self, *arguments: str, may_fail: bool = False) -> Sampled:
        """Run `mccd` under the sampler; raises as `mccd` does."""
        told = self.folder / "sampled.json"
        given = (str(self._sampler() or "-"), str(told), *arguments)
        ran = _checked(self.python("-m", "benchmarks.speed.sampled", *given), arguments, may_fail)
        return Sampled(ran.code, ran.out, ran.peak_mb, json.loads(told.read_text(encoding="utf-8")))

    def _sampler(self) -> Path | None:
        """Return the compiled sampler, None without gcc or on a processor that it does not know."""
        library, source = self.folder / "sampler.so", Path(__file__).with_name("sampler.c")
        if not library.exists() and shutil.which("gcc"):
            wanted = ["gcc", "-O2", "-shared", "-fPIC", "-o", str(library), str(source)]
            subprocess.run(wanted, check=False, timeout=60, stderr=subprocess.DEVNULL)
        return library if library.exists() else None


def _checked(ran: Ran, arguments: tuple[str, ...], may_fail: bool) -> Ran:
    if ran.code not in ((0, 1) if may_fail else (0,)):
        raise RuntimeError(f"mccd {' '.join(arguments)} ended with {ran.code}: {ran.out[-500:]}")
    return ran


@dataclass(frozen=True)
class Sampled(Ran):
    """A command that was sampled: `seen` is what `benchmarks.speed.sampled` wrote."""

    seen: dict[str, Any]

    def compiled(self) -> float:
        """Return the share of processor time in compiled code, in percent; no number where nobody could tell."""
        told = self.seen["shares"]
        return float("nan") if told is None else 100.0 * sum(told.get(name, 0.0) for name in COMPILED)

    def by_time(self) -> list[str]:
        """Return where the time went: kinds of code, then functions, compiled code as the line that calls it."""
        told, all_s = self.seen["shares"] or {}, self.seen["stacks_s"]
        kinds = ", ".join(f"{name} {100 * share:.1f} %" for name, share in told.items()) or "kinds of code: unknown"
        head = f"{self.seen['processor_s']:.1f} s of processor time in {self.seen['seconds']:.1f} s: {kinds}"
        return [head, *(f"{100 * s / all_s:.1f} % in {name}" for name, s in self.seen["own_time"])]

    def by_memory(self) -> list[str]:
        """Return where the memory that the process held grew, and by how much in all."""
        head = f"most memory, {self.seen['most_mb']:.0f} MB, was held in {' and '.join(self.seen['most_in'])}"
        return [head, *(f"grew by {mb:.0f} MB in all in {name}" for name, mb in self.seen["grown_mb"])]


def at_most_mb(ours: str, limit: float, of: Callable[[Any], Ran] = lambda result: result) -> Target:
    """Return the target that `ours` holds at most `limit` MB; `of` its result is the `Ran` of the command."""

    def peak(turn: Round) -> float:
        ran = of(turn.results[ours])
        return float("nan") if ran.peak_mb is None else ran.peak_mb

    return Target(f"{ours}: peak memory", limit, "MB", (ours,), peak, at_most=True)
