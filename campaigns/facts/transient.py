"""How long a repeating record takes to repeat: it began at rest or in another motion and rings until then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.facts.base import Array, Fact, Seen
from campaigns.facts.stretches import Stretch

NAME = "transient"

BLOCKS = 32
"""Parts of a period that are looked at."""

CHANCE = 1e-6
"""Chance at which a beginning differs so much from later periods by noise, over all that are looked at."""

LEAST = 1e-3
"""Difference, against the rms of the output, that no fit minds."""

SMOOTHED = 4
ABOVE = 1.5
"""Energy of so many parts against that of the noise at which a transient counts as over."""


@dataclass(frozen=True)
class _Start:
    label: str
    rows: int
    period: int
    periods: int
    differs: bool


def facts(seen: Seen, stretches: Sequence[Stretch], known: Sequence[Fact]) -> list[Fact]:
    """Return for each output how long the longest start takes until the periods repeat to the noise."""
    repeating = [s for s in stretches if s.periods >= 3]
    found = []
    for o, name in enumerate(seen.of_role("output")):
        starts = [_start_of(s, s.outputs[:, o], len(repeating)) for s in repeating if np.any(s.outputs[:, o])]
        if starts:
            found.append(_fact(name, starts, seen.rate_hz))
    return found


def _start_of(s: Stretch, values: Array, tests: int) -> _Start:
    """Return where the difference to the next period becomes that between later periods."""
    p, n = s.periods, s.period
    periods = values[: p * n].reshape(p, n)
    count = min(BLOCKS, n // 2)
    width = n // count
    apart = np.diff(periods, axis=0)[:, : width * count].reshape(p - 1, count, width)
    energy = np.mean(apart**2, axis=2)
    later = energy[p // 2 :]
    noise = float(later.mean())
    floor = max(noise, 0.5 * (LEAST * float(values.std())) ** 2)
    parts = [k for k in (1, 2, 4, 8) if 2 * k <= count]
    chance = CHANCE / (len(parts) * tests)
    differs = False
    for k in parts:
        # by how much the means over so many later parts scatter tells how many independent numbers each holds
        means = later[:, : count // k * k].reshape(-1, k).mean(axis=1)
        scatter = float(means.var(ddof=1))
        free = float(np.clip(2.0 * noise**2 / scatter, 1.0, k * width)) if scatter > 0.0 else 1.0
        limit = float(scipy.special.fdtri(free, means.size * free, 1.0 - chance))
        differs |= bool(energy[0, :k].mean() / floor > limit)
    if not differs:
        return _Start(s.label, 0, n, p, False)
    series = energy.reshape(-1)
    smooth = np.convolve(series, np.full(SMOOTHED, 1.0 / SMOOTHED), mode="valid")
    quiet = np.flatnonzero(smooth < ABOVE * floor)
    over = int(quiet[0]) + 1 if quiet.size else series.size
    return _Start(s.label, min(over * width, (p - 1) * n), n, p, True)


def _fact(name: str, starts: Sequence[_Start], rate_hz: float) -> Fact:
    longest = max(starts, key=lambda start: start.rows / start.period)
    begun = [start for start in starts if start.differs]
    numbers = {
        "rows": longest.rows,
        "s": longest.rows / rate_hz,
        "periods": -(-longest.rows // longest.period),
        "segments": len(begun),
    }
    if not begun:
        text = f"{name}: the first period differs from later ones by noise only"
        return Fact(NAME, text, channel=name, numbers=numbers, remark=False)
    half = longest.rows > 0.5 * (longest.periods - 1) * longest.period
    text = (
        f"{name}: {len(begun)} of {len(starts)} segments begin in another motion; the longest takes "
        f'{"at least " if half else ""}{longest.rows / rate_hz:.4g} s to repeat ("{longest.label}")'
    )
    means = (
        "it may still ring at the end: what differs between periods is then no noise; record more periods"
        if half
        else f"{numbers['periods']} periods at the start hold the transient and say nothing about the noise"
    )
    return Fact(NAME, text, means, name, longest.label, numbers, remark=half)
