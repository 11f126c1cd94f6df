"""Convergence of repetitive control: the error of every period, and the iteration from which it no longer falls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite

Array = NDArray[np.float64]

SETTLED = 0.10
"""Part of the final error by which a converged period may still exceed it."""


@dataclass(frozen=True)
class LearningCurve:
    """`rms` (p,) of the error of every period; `floor`, its mean over the last quarter; `converged_at`, an iteration.

    `converged_at` counts periods from 1: from it on every rms stays within 10 % of the floor, or within three standard
    deviations of the last quarter where those, being noise, are more. It is None when the error still falls: the floor
    is more than 10 % below any value before the last quarter.
    """

    rms: Array
    floor: float
    converged_at: int | None


def learning_curve(error: ArrayLike) -> LearningCurve:
    """Return the learning curve of errors (periods, samples); raises DataError for fewer than twelve periods."""
    e = finite("learning curve", error, 2, least=12)
    rms = np.sqrt(np.mean(e**2, axis=1))
    before, last = rms[: -(rms.size // 4)], rms[-(rms.size // 4) :]
    floor = float(last.mean())
    above = np.flatnonzero(rms > floor + max(SETTLED * floor, 3.0 * float(last.std(ddof=1))))
    first = int(above[-1]) + 1 if above.size else 0
    falling = floor < (1.0 - SETTLED) * before.min() or first >= rms.size - 1
    return LearningCurve(rms, floor, None if falling else first + 1)
