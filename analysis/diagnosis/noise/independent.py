"""The number of independent samples to which a stretch of coloured noise is equivalent."""

from __future__ import annotations

import numpy as np

from sim_backend.linear import Array


def independent_rows(e: Array) -> float:
    """Return of how many independent numbers the mean square of `e` (n,) is known: fewer where neighbours agree.

    n / (1 + 2 sum of squared correlations) numbers estimate a mean square as well as n correlated ones (Bartlett 1946).
    """
    power = np.abs(np.fft.rfft(e - e.mean(), 2 * e.size)) ** 2
    correlation = np.fft.irfft(power)[: e.size // 4]
    rho = correlation / max(float(correlation[0]), np.finfo(float).tiny)
    return float(e.size / (1.0 + 2.0 * float(np.sum(rho[1:] ** 2))))
