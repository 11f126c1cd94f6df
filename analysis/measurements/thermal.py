"""Robustness to temperature: drift of the chopped positions, and two frequency responses compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite
from sim_backend.errors import DataError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Drift:
    """Straight-line drift of `k` channels, arrays (k,): over the whole test, with a 95 % interval half width.

    `total_rad` is slope times duration, `std_rad` its standard deviation. `scatter_rad` is the largest distance of a
    position from the mean, `significant` whether the interval leaves zero out.
    """

    total_rad: Array
    std_rad: Array
    half_width_rad: Array
    scatter_rad: Array
    significant: NDArray[np.bool_]


def drift(time_s: ArrayLike, position_rad: ArrayLike) -> Drift:
    """Return the drift of mean positions (n, k) at times (n,); Fig. 6.16.

    The interval widens by the lag-one correlation of the residuals (effective number of independent positions).
    Raises DataError for fewer than four positions or times that stand still.
    """
    t = finite("drift: times", time_s, 1, least=4)
    y = finite("drift: positions", position_rad, 2, least=4)
    if t.size != y.shape[0] or np.ptp(t) == 0.0:
        raise DataError(f"drift: {t.size} times for {y.shape[0]} positions; give one rising time per position")
    dt = t - t.mean()
    slope = dt @ y / (dt @ dt)
    residual = y - y.mean(axis=0) - dt[:, None] * slope
    power = np.sum(residual**2, axis=0)
    lagged = np.sum(residual[1:] * residual[:-1], axis=0)
    correlation = np.clip(np.divide(lagged, power, out=np.zeros_like(power), where=power > 0.0), 0.0, 0.99)
    effective = np.maximum(t.size * (1.0 - correlation) / (1.0 + correlation), 3.0)
    error = np.sqrt(power / (effective - 2.0) / (dt @ dt))  # n_eff of n positions also hold n_eff/n of sum dt²
    span = float(np.ptp(t))
    half_width = scipy.stats.t.ppf(0.975, effective - 2.0) * error * span
    return Drift(
        total_rad=slope * span,
        std_rad=error * span,
        half_width_rad=half_width,
        scatter_rad=np.max(np.abs(y - y.mean(axis=0)), axis=0),
        significant=np.abs(slope * span) > half_width,
    )


@dataclass(frozen=True)
class SweepDifference:
    """Two sweeps over the same `f` frequencies: `difference_db` and its standard deviation, each (f,).

    `largest_db` is the difference of largest size, at `largest_hz`. `chi2_per_point` is about 1 when only noise
    differs; `p_value` is how often noise alone would give more.
    """

    difference_db: Array
    std_db: Array
    largest_db: float
    largest_hz: float
    chi2_per_point: float
    p_value: float


def compare_sweeps(
    frequency_hz: ArrayLike,
    first: ArrayLike,
    second: ArrayLike,
    first_relative_std: ArrayLike,
    second_relative_std: ArrayLike,
) -> SweepDifference:
    """Return the difference in magnitude of responses (f,), second over first, given relative standard deviations.

    Raises DataError when lengths differ or a magnitude is zero. Source: Fig. 6.17.
    """
    f = finite("sweeps: frequencies", frequency_hz, 1, least=1)
    a, b = np.abs(np.asarray(first)), np.abs(np.asarray(second))
    sa, sb = np.asarray(first_relative_std, dtype=float), np.asarray(second_relative_std, dtype=float)
    if not (a.shape == b.shape == sa.shape == sb.shape == f.shape and np.all(a > 0.0) and np.all(b > 0.0)):
        raise DataError(
            f"sweeps: shapes {f.shape}, {a.shape}, {b.shape}; give magnitudes above zero and deviations at the "
            f"same frequencies"
        )
    per_db = 20.0 / np.log(10.0)
    difference = per_db * np.log(b / a)
    std = per_db * np.hypot(sa, sb)
    k = int(np.argmax(np.abs(difference)))
    chi2 = float(np.sum(np.divide(difference, std, out=np.zeros_like(std), where=std > 0.0) ** 2))
    return SweepDifference(
        difference, std, float(difference[k]), float(f[k]), chi2 / f.size, float(scipy.stats.chi2.sf(chi2, f.size))
    )
