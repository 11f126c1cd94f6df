"""Does what differs between periods grow with the excitation? Then it is not a noise that a bench has by itself.

Whatever does not repeat with the drive is absorbed by noise: a stiffness that varies at a rate of its own, an
intermittent force, a friction that differs from pass to pass. In one record nothing distinguishes it from noise.
Records of several sizes do: a sensor's noise is the same in all of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.diagnosis.noise.independent import independent_rows
from analysis.diagnosis.records.dataset import Dataset, Record
from analysis.diagnosis.tails import f_tail
from analysis.diagnosis.verdict.lack_of_fit import ONE_IN_A_MILLION
from sim_backend.linear import Array

_TWICE = 2.0
"""Factor on the least motion of any record, and on its scatter as a power, from which on another record is compared."""


@dataclass(frozen=True)
class _Scatter:
    """What differs between the periods of one output of a record: its mean square, and of how many independent numbers.

    `motion` is the rms of the output about its mean.
    """

    mean_square: float
    numbers: float
    motion: float


def scatter_follows_play(data: Dataset, residuals: Sequence[Array]) -> str:
    """Return in words how the scatter between periods grows with the motion; nothing where it does not.

    `residuals` are (n, n_y) per record. It has to rise from record to record as the motion does, with a chance below
    10⁻⁶ in noise that is the same in all.
    """
    for o in range(data.n_outputs):
        found = [_scatter(r, e[:, o], o) for r, e in zip(data.records, residuals, strict=True) if _repeats(r)]
        found.sort(key=lambda one: one.motion)
        if len(found) < 2 or not found[-1].motion > _TWICE * found[0].motion:
            continue
        least, most = found[0], found[-1]
        ratio = most.mean_square / max(least.mean_square, np.finfo(float).tiny)
        chance = float(f_tail(ratio, most.numbers, least.numbers))
        rising = all(a.mean_square < b.mean_square for a, b in pairwise(found))
        if ratio > _TWICE and chance < ONE_IN_A_MILLION and rising:
            return (
                f"what differs between periods grows with the motion: its rms is {np.sqrt(ratio):.3g} times as large "
                f"where output {o + 1} moves {most.motion / least.motion:.3g} times as far. Noise that a bench has by "
                "itself does not; something that does not repeat with the drive does"
            )
    return ""


def _repeats(record: Record) -> bool:
    """Tell whether a record is one window with periods that tell its scatter."""
    return len(record.windows) == 1 and record.windows[0].repeated[1] >= 2


def _scatter(record: Record, residual: Array, o: int) -> _Scatter:
    (window,) = record.windows
    begin, count = window.repeated
    periods = residual[begin : begin + count * window.period].reshape(count, window.period)
    scatter = periods - periods.mean(axis=0)
    # the mean of the periods has taken its part
    part = (count - 1) / count
    numbers = part * independent_rows(scatter.ravel())
    return _Scatter(float(np.mean(scatter**2)) / part, numbers, float(np.std(record.y[:, o])))
