"""Rows of a score: a value with its interval, over how many cases, beside its target."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.intervals import bootstrap_interval, quantile_interval
from analysis.diagnosis.tails import share_interval

Array = NDArray[np.float64]

REPORTED = "-"
"""What replaces a requirement where there is none."""

BINS = ((0.0, 0.99, "below 0.99"), (0.99, 0.999, "0.99 to 0.999"), (0.999, 1.0, "0.999 to 1"))
"""Classes of stated probabilities: from, to (the last one inclusive), in words."""


@dataclass(frozen=True)
class Measure:
    """One row of the score: value and interval over `n` items, and what is required of it.

    The value must lie within `low` to `high`; where `stated` is given, the interval must hold it. `least` is the number
    of items that the design demands, 0 where none are.
    """

    name: str
    value: float | None
    interval: tuple[float, float] | None
    n: int
    low: float | None
    high: float | None
    must: str
    least: int = 0
    stated: float | None = None

    @property
    def ok(self) -> bool | None:
        """Whether the value meets its requirement; None without a value or a requirement."""
        if self.value is None or (self.low is None and self.high is None and self.stated is None):
            return None
        within = (self.low is None or self.value >= self.low) and (self.high is None or self.value <= self.high)
        if self.stated is None or self.interval is None:
            return within
        return within and self.interval[0] <= self.stated <= self.interval[1]

    @property
    def enough(self) -> bool:
        """Whether there are as many items as the design demands."""
        return self.n >= self.least

    @property
    def mark(self) -> str:
        """The outcome in words: yes, no, too few, or nothing where nothing is required."""
        if self.ok is False:
            return "no"
        if not self.enough:
            return "too few"
        return "yes" if self.ok else ""

    @property
    def counted(self) -> str:
        """The number of items, and how many are demanded where these are too few."""
        return str(self.n) if self.enough else f"{self.n} of {self.least}"


def share(
    name: str,
    hits: Iterable[bool],
    must: str = REPORTED,
    *,
    low: float | None = None,
    high: float | None = None,
    least: int = 0,
) -> Measure:
    """Return a share with its exact interval."""
    marks = list(hits)
    if not marks:
        return Measure(name, None, None, 0, low, high, must, least)
    k = sum(marks)
    return Measure(name, k / len(marks), share_interval(k, len(marks)), len(marks), low, high, must, least)


def median(name: str, groups: Sequence[Sequence[float]], must: str, high: float, scale: float = 1.0) -> Measure:
    """Return the median of all numbers over `scale`; the numbers of one case are resampled together."""
    filled = [np.asarray(g, dtype=float) / scale for g in groups if len(g)]
    if not filled:
        return Measure(name, None, None, 0, None, high, must, 1)
    everything = np.concatenate(filled)
    interval = bootstrap_interval(filled, _middle, np.random.default_rng(0))
    return Measure(name, _middle(everything), interval, everything.size, None, high, must, 1)


def quantile(name: str, values: Sequence[float], part: float) -> Measure:
    """Return the value that `part` of all lie below, with its exact interval; nothing is required of it."""
    value = float(np.quantile(values, part)) if values else None
    return Measure(name, value, quantile_interval(values, part), len(values), None, None, REPORTED)


def largest(name: str, values: Sequence[float], must: str = REPORTED, high: float | None = None) -> Measure:
    """Return the largest value, which has no interval; one value at least is demanded where there is a requirement."""
    least = 0 if high is None else 1
    return Measure(name, max(values, default=None), None, len(values), None, high, must, least)


def calibration(name: str, names: Sequence[tuple[float, bool]], least: int = 0) -> Measure:
    """Return the share of `names` (stated probability, whether it is right) that are right.

    The exact interval of that share must hold the mean of what was stated.
    """
    if not names:
        return Measure(name, None, None, 0, None, None, "the stated mean in the interval", least)
    stated = sum(probability for probability, _ in names) / len(names)
    right = share(name, [is_right for _, is_right in names])
    must = f"stated {stated:.5f} in the interval"
    return Measure(name, right.value, right.interval, right.n, None, None, must, least, stated)


def _middle(values: Array) -> float:
    return float(np.median(values))
