"""Hysteresis loops from a quasi-static sine: the linear part removed, remanent displacement and loop area."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite
from sim_backend.errors import DataError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Loop:
    """One loop, averaged over its cycles; `n` samples of one period.

    `torque_nm` and `deviation_rad` (n,) are the loop with its linear part `compliance_rad_nm` and offset removed.
    `remanence_rad` is half the displacement between both passages of zero torque, `remanence_std_rad` its scatter
    over cycles divided by the root of their number (zero for one cycle), `remanence_ratio` that over the angle's
    amplitude. `area_j` is ∮ M dθ, the energy given to the mechanism per cycle.
    """

    torque_nm: Array
    deviation_rad: Array
    compliance_rad_nm: float
    amplitude_rad: float
    remanence_rad: float
    remanence_std_rad: float
    remanence_ratio: float
    area_j: float


def loop(torque_nm: ArrayLike, angle_rad: ArrayLike, period: int, lag_s: float = 0.0, rate_hz: float = 1.0) -> Loop:
    """Return the loop of steady cycles (n,), of which whole periods of `period` samples are used; Fig. 6.7.

    `lag_s` is the linear plant's own lag at low frequency, 2 σ/ω² of its first mode: a moving spring with a damper
    draws an ellipse too, so the angle is read that much later against the torque (at `rate_hz`). Raises DataError
    for fewer samples than one period, or a torque that does not pass zero in both directions.
    """
    torque = finite("hysteresis loop: torque", torque_nm, 1, least=period)
    angle = finite("hysteresis loop: angle", angle_rad, 1, least=period)
    if torque.shape != angle.shape or period < 8:
        raise DataError(
            f"hysteresis loop: torque {torque.shape}, angle {angle.shape}, period {period}; "
            "give equal lengths and eight or more samples per period"
        )
    cycles = torque.size // period
    m = torque[: cycles * period].reshape(cycles, period)
    theta = _advanced(angle[: cycles * period].reshape(cycles, period), lag_s * rate_hz)
    mean_m, mean_theta = m.mean(axis=0), theta.mean(axis=0)
    centred = mean_m - mean_m.mean()
    if not np.any(centred):
        raise DataError(f"hysteresis loop: the torque stays at {mean_m[0]:.4g} N m; a loop needs a cycle through zero")
    compliance = float(centred @ mean_theta / (centred @ centred))
    deviation = mean_theta - mean_theta.mean() - compliance * centred
    remanences = np.array([_remanence(*cycle) for cycle in zip(m, theta, strict=True)])
    amplitude = 0.5 * float(np.ptp(mean_theta))
    remanence = _remanence(mean_m, mean_theta)
    scatter = float(remanences.std(ddof=1) / np.sqrt(cycles)) if cycles > 1 else 0.0
    following = np.roll(mean_theta, -1)
    area = float(np.sum(0.5 * (mean_m + np.roll(mean_m, -1)) * (following - mean_theta)))
    return Loop(
        mean_m, deviation, compliance, amplitude, remanence, scatter, remanence / amplitude if amplitude else 0.0, area
    )


def _advanced(cycles: Array, samples: float) -> Array:
    """Read periodic cycles (c, n) `samples` later, by the straight line between neighbours."""
    whole, part = int(np.floor(samples)), samples % 1.0
    return (1.0 - part) * np.roll(cycles, -whole, axis=1) + part * np.roll(cycles, -whole - 1, axis=1)


def _remanence(torque: Array, angle: Array) -> float:
    falling, rising = _at_zero(torque, angle, -1.0), _at_zero(torque, angle, 1.0)
    return 0.5 * abs(falling - rising)


def _at_zero(torque: Array, angle: Array, direction: float) -> float:
    """Angle where the periodic torque passes zero in a direction: a cubic through the samples around it.

    It takes in every sample within a fifth of the torque's amplitude, so that noise and the ringing of the suspension
    average out; the flank of a loop bends there by its fourth power, 2e-4 of the remanence.
    """
    signed = direction * torque
    k = np.flatnonzero((signed <= 0.0) & (np.roll(signed, -1) > 0.0))
    if k.size == 0:
        raise DataError("hysteresis loop: the torque does not pass zero in both directions; use cycles about zero")
    around = np.arange(-torque.size // 8, torque.size // 8 + 1) + int(k[0])
    reach = float(np.max(np.abs(torque)))
    near = around[np.abs(np.take(torque, around, mode="wrap")) < 0.2 * reach]
    order = 3 if near.size > 8 else 1
    near = near if near.size > 2 else np.array([k[0], k[0] + 1])
    flank = np.polyfit(np.take(torque, near, mode="wrap") / reach, np.take(angle, near, mode="wrap"), order)
    return float(flank[-1])
