"""How many of the first periods of a periodic record still hold the transient of its start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from campaigns.log import LogSegment, Run

_STANDS_OUT = 2.0
"""A period holds a transient when it differs from the last one by this many times what the last but one does: noise
alone gives ratios next to one, in a hundred samples within a quarter of it."""

_LOOKED_AT = 16
"""Periods at most that are looked at from the start: what rings longer than that is not a transient of a start."""


def settling_periods(parts: Sequence[tuple[Run, LogSegment]], period: int, count: int) -> int:
    """Return how many of the first of `count` periods of `period` samples still hold the transient of the start.

    The log's `transient_periods` if stated, the largest; otherwise each period is compared with the last one. Of two
    periods none: a transient and noise cannot be distinguished.
    """
    stated = [int(s.settings["transient_periods"]) for _, s in parts if "transient_periods" in s.settings]
    if stated:
        return max(stated)
    if count < 3:
        return 0
    return max(_seen(run, segment, name, period, count) for run, segment in parts for name in run.names("output"))


def _seen(run: Run, segment: LogSegment, name: str, period: int, count: int) -> int:
    def distance(k: int) -> float:
        return float(np.sqrt(np.mean((played(k) - last) ** 2)))

    def played(k: int) -> np.ndarray:
        return run.read(name, segment.start + k * period, segment.start + (k + 1) * period)

    last = played(count - 1)
    noise = distance(count - 2)
    off = [k for k in range(min(count - 2, _LOOKED_AT)) if distance(k) > _STANDS_OUT * noise]
    return max(off, default=-1) + 1
