"""Noise that a short filter leaves stronger at low frequencies, in tests of bins and of means.

In the cosine basis the level of a band is a plain factor, so that noise of any colour becomes white: with the cosine
transform C, levels f and L = C^T f^(-1/2) C, whitened columns A and residual w give the normal equations A^T L^2 A and
A^T L^2 w. L differs from one in the lowest coefficients only, and A^T L^2 A = A^T A - (C A)^T (1 - 1/f) (C A) over
these.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.noise.whitener import Whitener, filtered
from sim_backend.linear import Array

Indices = NDArray[np.int64]

_LOUDER = 1.1
"""A level that is nearer to one is one, as far as it is known."""

_TOGETHER = 8
"""Columns that are transformed at a time."""


def first_of_fast(n: int, least: int) -> int:
    """Return how many of `n` samples to leave out, at least `least`, so that the others have a fast transform length.

    Beyond `least` that is up to 1.6 % of `n` at n = 2000, and less of longer records; a length with a large prime
    factor takes ten times as long.
    """
    return n - next(m for m in range(n - least, 0, -1) if scipy.fft.next_fast_len(m) == m)


def low_levels(whitener: Whitener, n: int, output: int) -> Array:
    """Return the levels (k,) of the lowest of `n` cosine coefficients, up to the last that is louder than white."""
    levels = whitener.band_levels(n, output) if whitener.levels.size else np.zeros(0)
    loud = np.flatnonzero(levels > _LOUDER)
    return levels[: int(loud[-1]) + 1] if loud.size else levels[:0]


def levelled(values: Array, levels: Array) -> Array:
    """Return `values` (n,) or (n, k), whitened but for the `levels` of their lowest coefficients, divided by these."""
    if not levels.size:
        return values
    rows = cosine_rows(np.ascontiguousarray(values.T), levels)
    return np.asarray(scipy.fft.idct(rows, norm="ortho", overwrite_x=True).T)


def cosine_rows(series: Array, levels: Array) -> Array:
    """Return `series` (n,) or each of (k, n), whitened but for `levels`, in the cosine basis with these divided out.

    Its inner products are those of the levelled series themselves: the basis is orthonormal.
    """
    rows = scipy.fft.dct(series, norm="ortho")
    rows[..., : levels.size] /= np.sqrt(levels)
    return np.asarray(rows)


def excess_of_indicators(taps: Array, index: Indices, count: int, levels: Array) -> Array:
    """Return by how much dividing by the levels reduces the normal matrix (count, count) of whitened indicators.

    `index` (n,) numbers the bin of every sample, -1 for none.
    """
    low = np.empty((count, levels.size))
    for some in range(0, count, _TOGETHER):
        bins = np.arange(some, min(some + _TOGETHER, count))
        acting = (index == bins[:, None]).astype(float)
        low[bins] = scipy.fft.dct(filtered(taps, acting), axis=1, norm="ortho", overwrite_x=True)[:, : levels.size]
    return np.asarray((low * (1.0 - 1.0 / levels)) @ low.T)
