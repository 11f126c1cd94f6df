"""Power that a chop dissipates in the coils, and the largest current it draws."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite, positive
from sim_backend.errors import DataError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class CoilPower:
    """Mean dissipation of `a` actuators, `actuator_w` (a,), and in all, `total_w`; largest current, `peak_a`."""

    actuator_w: Array
    total_w: float
    peak_a: float


def coil_power(
    current_a: ArrayLike, force_constant_n_a: float, steepness_n_sqrt_w: float, period: int | None = None
) -> CoilPower:
    """Return power and peak of currents (n, a), over whole periods of `period` samples where it is given.

    A coil with force constant k and steepness K (force per root of watt) dissipates (k i / K)²; section 6.2.1.
    Raises DataError for a constant that is not positive or a record shorter than a period.
    """
    i = finite("coil power: currents", current_a, 2, least=1)
    ratio = positive("force constant", force_constant_n_a) / positive("actuator steepness", steepness_n_sqrt_w)
    if period is not None:
        whole = i.shape[0] // period * period if period > 0 else 0
        if whole == 0:
            raise DataError(f"coil power: {i.shape[0]} samples hold no whole period of {period}; record longer")
        i = i[:whole]
    rows = np.ascontiguousarray(i.T)  # along a row sums are several times faster
    actuator = ratio**2 * np.mean(rows**2, axis=1)
    return CoilPower(actuator, float(actuator.sum()), float(max(rows.max(), -rows.min())))


def joined_power(parts: Iterable[tuple[CoilPower, int]]) -> CoilPower:
    """Return the power over consecutive parts of one record, each with its number of samples."""
    powers, samples = zip(*parts, strict=True)
    share = np.array(samples) / sum(samples)
    actuator = np.sum([power.actuator_w * s for power, s in zip(powers, share, strict=True)], axis=0)
    return CoilPower(actuator, float(actuator.sum()), max(power.peak_a for power in powers))
