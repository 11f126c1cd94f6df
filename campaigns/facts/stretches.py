"""The stretches of a record in which something is driven, as the facts on inputs and outputs together look at them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.facts.base import Array, Fact, Seen
from campaigns.facts.period import claimed_period, difference

LEAST_ROWS = 200
"""Samples of a segment below which nothing is asked of it: too few for a spectrum and a handful of lags."""

VARIES = 0.1
"""What inputs may differ by from period to period, against their size: a hundredth of the power of what they move."""


@dataclass(frozen=True)
class Stretch:
    """Samples of a segment from `start`: inputs (n, n_u), outputs (n, n_y), references (n, n_r), without their means.

    `period` is in samples, 0 where nothing repeats.
    """

    label: str
    start: int
    inputs: Array
    outputs: Array
    references: Array
    period: int

    @property
    def rows(self) -> int:
        """Number of samples."""
        return int(self.inputs.shape[0])

    @property
    def periods(self) -> int:
        """Number of whole periods, 0 where nothing repeats."""
        return self.rows // self.period if self.period else 0


def stretches_in(seen: Seen, known: Sequence[Fact]) -> list[Stretch]:
    """Return the segments of a record in which an input and an output move, until its end.

    A period that the facts `known` forbid counts as none. Segments of one frequency each are left out: they have facts
    of their own, and nothing but that frequency.
    """
    forbidden = {fact.segment for fact in known if fact.name == "period" and fact.forbids}
    end = min((int(fact.numbers["start"]) for fact in known if fact.name == "ended"), default=seen.rows)
    roles = [list(seen.of_role(role).values()) for role in ("input", "output", "reference")]
    found = []
    for segment in seen.segments:
        stop = min(segment.stop, end)
        if stop - segment.start < LEAST_ROWS or {"frequency_hz", "measure_from"} & set(segment.settings):
            continue
        u, y, r = (_part(columns, segment.start, stop) for columns in roles)
        if not (np.any(u) and np.any(y)):
            continue
        period = 0 if segment.label in forbidden else claimed_period(segment)
        found.append(Stretch(segment.label, segment.start, u, y, r, period if _repeats(u, period) else 0))
    return found


def _repeats(u: Array, period: int) -> bool:
    """Tell whether all inputs (n, n_u) that move repeat after a period; those of a loop that learns do not."""
    if not 1 < period <= u.shape[0] // 2:
        return False
    size = u.std(axis=0)
    return difference(u[:, size > 0.0] / size[size > 0.0], period) < VARIES


def _part(columns: Sequence[Array], start: int, stop: int) -> Array:
    """Return columns (n,) as (rows, k) without their means; what is constant is zero exactly."""
    out = np.zeros((stop - start, len(columns)))
    for k, values in enumerate(columns):
        part = values[start:stop]
        if np.ptp(part) > 0.0:
            out[:, k] = part - part.mean()
    return out
