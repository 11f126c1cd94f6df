"""A bell curve fitted to a histogram, as the paper did, beside the moments of the same samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite, positive
from sim_backend.errors import DataError

Array = NDArray[np.float64]

BIN_RAD = 0.1e-6
"""Bin width of the paper's histograms, section 6.4.1."""

_MOST_BINS = 1_000_000


@dataclass(frozen=True)
class GaussianFit:
    """Histogram of one channel and its bell curve, `b` bins: `centre_rad` and `count` (b,).

    `peak`, `mean_rad` and `sigma_rad` are of the least-squares curve through the counts, unweighted; `moment_mean_rad`
    and `moment_sigma_rad` of the samples themselves. `excess_kurtosis` is 0 for Gaussian samples.
    """

    centre_rad: Array
    count: Array
    peak: float
    mean_rad: float
    sigma_rad: float
    moment_mean_rad: float
    moment_sigma_rad: float
    excess_kurtosis: float

    def curve(self, at_rad: Array) -> Array:
        """Return the fitted counts at the given values, any shape."""
        return np.asarray(self.peak * np.exp(-0.5 * ((at_rad - self.mean_rad) / self.sigma_rad) ** 2))


def gaussian_fit(samples_rad: ArrayLike, bin_rad: float = BIN_RAD) -> GaussianFit:
    """Return the bell curve through the histogram of samples (n,) with bins centred on multiples of `bin_rad`.

    Raises DataError when the samples fill fewer than four bins, or more than a million.
    """
    x = finite("histogram", samples_rad, 1, least=4)
    step = positive("histogram: the bin width", bin_rad)
    index = np.rint(x / step)
    low, high = index.min(), index.max()
    if not 4 <= high - low + 1 <= _MOST_BINS:
        raise DataError(
            f"histogram: samples over {high - low + 1:.0f} bins of {step:.3g}; choose a bin width that gives 4 or more"
        )
    count = np.bincount((index - low).astype(np.int64)).astype(float)
    centre = (low + np.arange(count.size)) * step
    mean, sigma = float(x.mean()), float(x.std())
    # in units of the samples' own scale, so that the fit's steps have the same size in every parameter
    start_peak = x.size * step / (sigma * np.sqrt(2.0 * np.pi))
    (peak, shift, width), _ = scipy.optimize.curve_fit(
        lambda z, p, s, w: p * np.exp(-0.5 * ((z - s) / w) ** 2),
        (centre - mean) / sigma,
        count / start_peak,
        p0=(1.0, 0.0, 1.0),
    )
    kurtosis = float(np.mean((x - mean) ** 4) / sigma**4 - 3.0)
    return GaussianFit(
        centre, count, peak * start_peak, mean + shift * sigma, abs(width) * sigma, mean, sigma, kurtosis
    )
