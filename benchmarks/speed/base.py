"""What a speed benchmark is: one piece of work, who does it, what proves that all did the same, and what to reach."""

from __future__ import annotations

import importlib.metadata
import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Contender:
    """One way to do the work: `run` does it once and returns what it computed.

    `amount` is how much of the work one run does, in units of the benchmark's choice (samples, simulated seconds): all
    times are taken per unit, so that a slow peer may do a small part. It is run `rounds` times at most, the first
    `warm` times without being timed (compilation, caches). `profile` runs it once more, when a target of its own is
    missed, and says where its time or memory goes; without it, it is profiled within this process.
    """

    name: str
    run: Callable[[], Any]
    amount: float = 1.0
    rounds: int = 1000
    warm: int = 1
    profile: Callable[[], list[str]] | None = None


@dataclass(frozen=True)
class Agreement:
    """How far one contender's result is from the reference of the benchmark, and how far it may be, with the reason."""

    name: str
    error: float
    allowed: float
    what: str

    @property
    def holds(self) -> bool:
        """Tell whether the error is allowed; one that is no number is not."""
        return bool(self.error <= self.allowed)


@dataclass(frozen=True)
class Round:
    """One turn of every contender: `seconds` per unit of work and `results` by contender."""

    seconds: Mapping[str, float]
    results: Mapping[str, Any]


@dataclass(frozen=True)
class Target:
    """A number to reach: `value` takes it from one round, of whose contenders it needs `needs`.

    It is reached when the median over the rounds is at least (or, with `at_most`, at most) `limit`.
    """

    what: str
    limit: float
    unit: str
    needs: tuple[str, ...]
    value: Callable[[Round], float]
    at_most: bool = False

    def reached(self, value: float) -> bool:
        """Tell whether `value` is good enough."""
        return bool(value <= self.limit if self.at_most else value >= self.limit)


@dataclass(frozen=True)
class Prepared:
    """A benchmark ready to run: its contenders, and `check`, which compares their results by name.

    `absent` says why a contender is missing; `facts` (sizes, versions) go into the results file. `profiles` returns,
    from the results, where contenders that were watched spent their time or memory, by a name of its own.
    """

    contenders: tuple[Contender, ...]
    check: Callable[[Mapping[str, Any]], list[Agreement]]
    absent: Mapping[str, str]
    facts: Mapping[str, Any]
    profiles: Callable[[Mapping[str, Any]], Mapping[str, list[str]]] = lambda results: {}


@dataclass(frozen=True)
class Benchmark:
    """One row of the table: `prepare` gets `quick` (small sizes) and a temporary folder of its own.

    `missed` holds, by the text of a target, why it is not reached: it is told only while that is so. With `one_core`
    all work is done by one thread of this process, and times are those of the processor, so that what else the machine
    does is left out. Otherwise they are those of the clock on the wall.
    """

    name: str
    work: str
    prepare: Callable[[bool, Path], Prepared]
    targets: tuple[Target, ...]
    missed: Mapping[str, str]
    one_core: bool = False


def times_faster(ours: str, peer: str, limit: float) -> Target:
    """Return the target that `ours` takes at most a `limit`-th of the time of `peer`."""
    return Target(
        f"{ours}: times as fast as {peer}",
        limit,
        "×",
        (ours, peer),
        lambda turn: turn.seconds[peer] / turn.seconds[ours],
    )


def times_the_time(ours: str, peer: str, limit: float) -> Target:
    """Return the target that `ours` takes at most `limit` times the time of `peer`."""
    return Target(
        f"{ours}: time ÷ that of {peer}",
        limit,
        "×",
        (ours, peer),
        lambda turn: turn.seconds[ours] / turn.seconds[peer],
        at_most=True,
    )


def at_most_seconds(ours: str, limit: float) -> Target:
    """Return the target that one unit of work takes `ours` at most `limit` seconds."""
    return Target(f"{ours}: time", limit, "s", (ours,), lambda turn: turn.seconds[ours], at_most=True)


def missing(module: str, distribution: str) -> str | None:
    """Return why a peer cannot run, None if `module` can be imported."""
    if importlib.util.find_spec(module) is not None:
        return None
    return f"not installed: {distribution} is in the extra `peers`"


def version_of(distribution: str) -> str:
    """Return the version of an installed distribution, `absent` if there is none."""
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return "absent"
