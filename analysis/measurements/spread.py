"""Standard deviation of a record about its straight line, with an uncertainty that holds for coloured noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Spread:
    """Scatter of `k` channels, each array (k,): `std` about the trend, its own `std_error`, and the `slope` per sample.

    `std_error` assumes Gaussian noise of any colour that is stationary over the record.
    """

    std: Array
    std_error: Array
    slope: Array


def detrended(values: ArrayLike) -> tuple[Array, Array]:
    """Return records (n, k) without their least-squares straight lines, and the slopes (k,) per sample.

    Raises DataError for fewer than three samples or a number that is not finite.
    """
    y = finite("trend", values, 2, least=3)
    t = np.arange(y.shape[0]) - 0.5 * (y.shape[0] - 1)
    slope = t @ y / (t @ t)
    return y - y.mean(axis=0) - t[:, None] * slope, slope


def spread(values: ArrayLike) -> Spread:
    """Return the scatter of records (n, k) about their straight lines; raises as `detrended`.

    The variance is the sum of the periodogram. Its ordinates are independent and exponential, so the variance of
    that sum is the sum of their squared means, estimated by half the sum of their squares; no white noise is assumed.
    """
    y, slope = detrended(values)
    n = y.shape[0]
    lines = np.fft.rfft(y, axis=0)
    power = (lines.real**2 + lines.imag**2) / n**2
    inner = slice(1, n // 2 if n % 2 == 0 else None)  # every line but the mean and the one at half the rate is doubled
    power[inner] *= 2.0
    variance = np.sum(y**2, axis=0) / (n - 2)
    error = np.sqrt(0.5 * np.sum(power[1:] ** 2, axis=0))
    std = np.sqrt(variance)
    return Spread(std, np.divide(error, 2.0 * std, out=np.zeros_like(std), where=std > 0.0), slope)
