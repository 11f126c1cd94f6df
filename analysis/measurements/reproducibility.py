"""Cycle-to-cycle reproducibility: how far repeats of one motion lie apart, during the step and while integrating."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite
from sim_backend.errors import DataError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Reproducibility:
    """Deviation of cycles from their mean, in the units of the record.

    `three_sigma` (n,) is per sample of the period. `step` and `integration` are 3σ pooled over the samples of each;
    `step_largest` and `integration_largest` the largest single deviations, which grow with the number of cycles.
    """

    three_sigma: Array
    step: float
    integration: float
    step_largest: float
    integration_largest: float


def reproducibility(cycles: ArrayLike, in_step: ArrayLike) -> Reproducibility:
    """Return the reproducibility of cycles (c, n), given which samples of the period (n,) belong to a step.

    Raises DataError for fewer than three cycles, or when no sample or every sample is in a step. Source: section 6.3.2.
    """
    y = finite("reproducibility", cycles, 2, least=3)
    moving = np.asarray(in_step, dtype=bool)
    if moving.shape != (y.shape[1],) or moving.all() or not moving.any():
        raise DataError(
            f"reproducibility: {int(np.sum(moving))} of {y.shape[1]} samples are marked as a step; mark some, not all"
        )
    deviation = y - y.mean(axis=0)
    variance = np.sum(deviation**2, axis=0) / (y.shape[0] - 1)

    def pooled(where: NDArray[np.bool_]) -> tuple[float, float]:
        return 3.0 * float(np.sqrt(variance[where].mean())), float(np.max(np.abs(deviation[:, where])))

    (step, step_largest), (integration, integration_largest) = pooled(moving), pooled(~moving)
    return Reproducibility(3.0 * np.sqrt(variance), step, integration, step_largest, integration_largest)
