"""Convergence of repetitive control: the error of every period, and the iteration from which it no longer falls."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.arrays import finite

Array = NDArray[np.float64]

SETTLED = 0.10
"""Part of the final error by which a converged period may still exceed it."""


@dataclass(frozen=True)
class LearningCurve:
    """`rms` (p,) of the error of every period; `floor`, its mean over the last quarter; `converged_at`, an iteration.

    `converged_at` counts periods from 1: from it on every rms stays within the scatter of the last quarter (three
    standard deviations) or within 10 % of the floor, whichever is more. None when only the last period would.
    """

    rms: Array
    floor: float
    converged_at: int | None


def learning_curve(error: ArrayLike) -> LearningCurve:
    """Return the learning curve of errors (periods, samples); raises DataError for fewer than eight periods."""
    e = finite("learning curve", error, 2, least=8)
    rms = np.sqrt(np.mean(e**2, axis=1))
    last = rms[-(rms.size // 4) :]
    floor = float(last.mean())
    limit = floor + max(SETTLED * floor, 3.0 * float(last.std(ddof=1)))
    above = np.flatnonzero(rms > limit)
    first = int(above[-1]) + 1 if above.size else 0
    return LearningCurve(rms, floor, first + 1 if first < rms.size - 1 else None)
