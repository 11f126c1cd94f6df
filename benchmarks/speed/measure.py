"""Run a benchmark: contenders by turns, what they computed compared, and the targets' numbers taken round by round."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from benchmarks.speed.base import Benchmark, Contender, Prepared, Round, Target
from benchmarks.speed.profile import profile


def measure(benchmark: Benchmark, rounds: int, quick: bool, clock: Callable[[], float] | None = None) -> Any:
    """Return everything that is known of a benchmark after `rounds` rounds, ready for JSON.

    In each round every contender has its turn, in an order that changes from round to round, so that what the machine
    does besides strikes all alike; a target's number is taken from the times of one round.
    """
    clock = clock or (time.process_time if benchmark.one_core else time.perf_counter)
    with TemporaryDirectory(prefix="mccd-bench-") as folder:
        prepared = benchmark.prepare(quick, Path(folder))
        seconds, values, results = _turns(prepared.contenders, benchmark.targets, rounds, clock)
        agreements = prepared.check(results)
        targets = [_told_target(benchmark, t, v, prepared) for t, v in zip(benchmark.targets, values, strict=True)]
        late = {target["of"] for target in targets if target["reached"] is False}
        profiles = dict(prepared.profiles(results))
        for contender in prepared.contenders:
            if contender.name in late and not quick:
                profiles[contender.name] = (contender.profile or partial(profile, contender.run))()
    return {
        "name": benchmark.name,
        "work": benchmark.work,
        "clock": "processor, of this process" if benchmark.one_core else "wall",
        "facts": dict(prepared.facts),
        "contenders": {c.name: _told_times(c, seconds) for c in prepared.contenders},
        "absent": dict(prepared.absent),
        "agreements": [{**asdict(a), "holds": a.holds} for a in agreements],
        "targets": targets,
        "profiles": profiles,
    }


def _turns(
    contenders: Sequence[Contender], targets: Sequence[Target], rounds: int, clock: Callable[[], float]
) -> tuple[list[dict[str, float]], list[list[float]], dict[str, Any]]:
    """Return seconds by contender of each round, the numbers of each target, and the latest results by contender.

    Older results are given up: kept, they would make every contender wait for memory that was never used before.
    """
    results: dict[str, Any] = {}
    for contender in contenders:
        for _ in range(contender.warm):
            results[contender.name] = contender.run()
    all_seconds: list[dict[str, float]] = []
    values: list[list[float]] = [[] for _ in targets]
    for number in range(rounds):
        seconds: dict[str, float] = {}
        first = number % len(contenders)
        for contender in [*contenders[first:], *contenders[:first]]:
            if number < contender.rounds:
                results.pop(contender.name, None)
                started = clock()
                results[contender.name] = contender.run()
                seconds[contender.name] = (clock() - started) / contender.amount
        all_seconds.append(seconds)
        for target, numbers in zip(targets, values, strict=True):
            if all(name in seconds for name in target.needs):
                numbers.append(target.value(Round(seconds, results)))
    return all_seconds, values, results


def _told_times(contender: Contender, seconds: Sequence[Mapping[str, float]]) -> dict[str, Any]:
    own = [turn[contender.name] for turn in seconds if contender.name in turn]
    return {"amount": contender.amount, "seconds_per_unit": _spread(own)}


def _told_target(benchmark: Benchmark, target: Target, values: Sequence[float], prepared: Prepared) -> dict[str, Any]:
    told: dict[str, Any] = {
        "what": target.what,
        "of": target.needs[0],
        "limit": target.limit,
        "at_most": target.at_most,
        "unit": target.unit,
        "reached": None,
    }
    known = {c.name for c in prepared.contenders}
    lacking = [name for name in target.needs if name not in known]
    if lacking:
        return {**told, "why": "; ".join(f"{name}: {prepared.absent.get(name, 'absent')}" for name in lacking)}
    if not all(map(math.isfinite, values)):
        return {**told, "why": "nothing here tells this number (no gcc, or another kind of system)"}
    spread = _spread(values)
    reached = target.reached(spread["median"])
    told.update(spread, reached=reached)
    if not reached and target.what in benchmark.missed:
        told["why"] = benchmark.missed[target.what]
    return told


def _spread(values: Sequence[float]) -> dict[str, Any]:
    return {
        "median": float(np.median(values)),
        "lowest": float(np.min(values)),
        "highest": float(np.max(values)),
        "rounds": len(values),
    }
