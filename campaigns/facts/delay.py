"""How many samples after an input an output first answers: what comes before is a delay, whatever the mechanics are.

A phase that grows with frequency may be resonances as well as a delay; the first answer to an input cannot come before
the delay is over. A motion begins small, though: where the sample before the first answer that is seen could hide a
smaller one in the noise, the delay is bounded, not stated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy

from campaigns.facts.base import Array, Fact, Seen
from campaigns.facts.clock import NAME as CLOCK
from campaigns.facts.loop import NAME as LOOP
from campaigns.facts.regression import AHEAD, FRESH, Regression, regression_of, triangle_of
from campaigns.facts.stretches import Stretch

NAME = "delay"

SEEN = 5.0
"""Standard deviations of the first answer that counts as one."""

HIDDEN = 3.5
"""Standard deviations below which an answer could still be hidden."""

SLOW_START = 7.0
"""By how much a motion that begins with the cube of time, a force through a lag, is smaller one sample before its
second; of lower powers it is smaller by less."""

MISSED = 0.1
"""Part of the innovations of an output that inputs before the order may explain: new inputs only add to the noise."""


def facts(seen: Seen, stretches: Sequence[Stretch], known: Sequence[Fact]) -> list[Fact]:
    """Return the delay of every pair of which the output answers the input."""
    if not stretches:
        return []
    if any(fact.name == CLOCK and fact.numbers["found"] for fact in known):
        text = "the delay is not known: the clocks of inputs and outputs differ, so that it changes with time"
        return [Fact(NAME, text, remark=False)]
    if any(fact.name == LOOP and fact.numbers.get("found") for fact in known):
        return [Fact(NAME, "the delay is not known: in a closed loop the first answer is the loop's", remark=False)]
    found = []
    for o, output in enumerate(seen.of_role("output")):
        regression = regression_of(stretches, o)
        if regression is None:
            continue
        # all lags there are: a delay longer than the order would be missed
        regression = replace(regression, order=int(regression.lag.max()) - AHEAD)
        for j, name in enumerate(seen.of_role("input")):
            found += _of_pair(regression, j, name, output, seen.rate_hz)
    return found


def _of_pair(regression: Regression, j: int, name: str, output: str, rate_hz: float) -> list[Fact]:
    sizes, fresh = _answers(regression, j)
    seen_at = np.flatnonzero(np.abs(sizes) > SEEN)
    first = int(seen_at[0]) if seen_at.size else sizes.size - 1
    pair = f"{name} → {output}"
    if fresh[: first + 2].min() < FRESH:
        text = (
            f"{pair}: the delay is not known: {name} is too smooth, or has too few frequency lines, "
            "to distinguish its samples"
        )
        return [Fact(NAME, text, remark=False)]
    if not seen_at.size:
        return []  # this input does not move this output, or no more than others do
    if _missed(regression) > MISSED or np.any(np.abs(sizes[:first]) > HIDDEN):
        return [Fact(NAME, f"{pair}: the delay is not known: no linear model follows closely enough", remark=False)]
    if abs(sizes[first]) < SLOW_START * HIDDEN:
        text = (
            f"{pair}: the delay is not known: at most {first} samples, {first / rate_hz:.4g} s; noise hides the start"
        )
        return [Fact(NAME, text, channel=output, numbers={"most": first}, remark=False)]
    least = max(first - 1, 0)
    std = 1.0 / np.sqrt(12.0)
    text = (
        f"{pair}: the first answer is seen {first} samples after, {first / rate_hz:.4g} s: "
        f"a delay of {least} to {first} samples, {least / rate_hz:.4g} s to {first / rate_hz:.4g} s"
    )
    numbers = {
        "first": first,
        "samples": 0.5 * (least + first),
        "std_samples": std * (first - least),
        "s": 0.5 * (least + first) / rate_hz,
        "std_s": std * (first - least) / rate_hz,
    }
    late = first >= 2
    means = "held inputs are answered one sample after: the rest is a delay of the drive, the sensor or the recorder"
    return [Fact(NAME, text, means if late else "", output, numbers=numbers, remark=late)]


def _answers(regression: Regression, j: int) -> tuple[Array, Array]:
    """Return the direct answers (order + 1,) to an input at each lag, in standard deviations.

    Beside them, which part of that sample's power all others and the output leave.
    """
    columns = np.flatnonzero(regression.past)
    triangle = triangle_of(regression.triangle[:, [*columns, -1]])
    inner, right = triangle[:-1, :-1], triangle[:-1, -1]
    own = np.flatnonzero(regression.of[columns] == j)
    own = own[np.argsort(regression.lag[columns][own])]
    scale = np.sqrt((inner**2).sum(axis=0))
    if np.any(np.abs(np.diag(inner)) <= 1e-12 * scale):
        return np.zeros(own.size), np.zeros(own.size)
    inverse = scipy.linalg.solve_triangular(inner, np.eye(columns.size))
    variance = triangle[-1, -1] ** 2 / max(regression.rows - columns.size, 1.0)
    std = np.sqrt(variance * (inverse**2).sum(axis=1))
    sizes = (inverse @ right) / np.maximum(std, np.finfo(float).tiny)
    fresh = 1.0 / ((inverse**2).sum(axis=1) * scale**2)
    return sizes[own], fresh[own]


def _missed(regression: Regression) -> float:
    """Return which part of what is new in the output inputs before the order hold."""
    plain, before = regression.left([regression.past, regression.before])
    return (plain - before) / plain - int(regression.before.sum()) / regression.rows if plain > 0.0 else 0.0
