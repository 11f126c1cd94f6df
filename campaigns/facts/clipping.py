"""Readings cut off at the end of a sensor's or a converter's range."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.base import Array, Fact, Seen, by_segment, runs_of
from campaigns.facts.steps import step_of

NAME = "clipping"

COARSE = 0.1
"""Step of a channel that counts, against its standard deviation, from which on its extremes are held for long."""

SATURATED_SHARE = 1e-3
"""Share of the samples that may stand at an extreme before it counts as a limit of the sensor."""


def facts(seen: Seen) -> list[Fact]:
    """Return the outputs that are cut off, by segment."""
    return [
        fact
        for name, values in seen.of_role("output").items()
        for segment, part in by_segment(seen, values)
        for fact in cut_off_in(part, name, seen.channels[name].unit, segment.label)
    ]


def cut_off_in(values: Array, name: str, unit: str, segment: str) -> list[Fact]:
    """Return at which ends an output (n,) is cut off in a segment."""
    return [
        Fact(
            NAME,
            f'{name} is cut off at {level:.6g} {unit} in {100.0 * share:.2f} % of the samples of "{segment}"',
            "the sensor is at its end there: such samples are no measurement and are left out of every fit",
            name,
            segment,
            {"share": share, "level": level},
        )
        for share, level in saturation(values)
    ]


def cut_off(found: Iterable[Fact], segment: str, rows: int, read: Callable[[str], Array]) -> NDArray[np.bool_]:
    """Return (rows,) in which samples of a segment an output is at its end, by the facts `found` of the record.

    `read` gives the segment's part of a channel (rows,).
    """
    cut = np.zeros(rows, dtype=bool)
    for fact in found:
        if fact.name == NAME and fact.segment == segment:
            cut |= read(fact.channel) == fact.numbers["level"]
    return cut


def saturation(values: Array) -> list[tuple[float, float]]:
    """Return (share of samples cut off there, extreme) for each end at which a channel (n,) is cut off, at most two.

    A limited sensor stays exactly at its extreme for samples on end although the motion was heading beyond it; one
    that rests or turns there arrives slowly. Inputs are not judged: a two-level signal is at its extremes always.
    """
    steps = np.abs(np.diff(values))
    rms_step = float(np.sqrt(np.mean(steps**2))) if steps.size else 0.0
    ends: list[tuple[float, float]] = []
    if rms_step == 0.0 or step_of(values) > COARSE * float(values.std()):
        return ends  # of coarse counts the highest one is no end
    for sign in (1.0, -1.0):
        x = sign * values
        top = float(x.max())
        starts, stops = runs_of(x == top)
        long = stops - starts >= 3
        share = float((stops - starts)[long].sum()) / x.size
        if share <= SATURATED_SHARE:
            continue
        beyond = [_overshoot(x, a, b) for a, b in zip(starts[long], stops[long], strict=True)]
        # half a typical step: a clipped sine of 95 % crosses with 0.4 of it per sample, a start from rest with 0.05
        if float(np.median(beyond)) > 0.5 * rms_step:
            ends.append((share, sign * top))
    return ends


def _overshoot(x: Array, start: int, stop: int) -> float:
    """Return how far straight lines through the samples before and after a stay at the top lead beyond it."""
    half = min((stop - start) / 2.0, 3.0)
    before = (x[start - 1] - x[start - 3]) / 2.0 * half + x[start - 1] - x[start] if start >= 3 else 0.0
    after = (x[stop] - x[stop + 2]) / 2.0 * half + x[stop] - x[start] if stop + 2 < x.size else 0.0
    return float(max(before, after))
