"""Samples sorted into bins, and the tests of bins: larger than the noise, or of a mean that follows them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.tails import f_tail
from sim_backend.jit import njit
from sim_backend.linear import Array

Indices = NDArray[np.int64]

ROWS_PER_BIN = 100


@dataclass(frozen=True)
class Binned:
    """Samples by bin: `index` (n,) is the bin of each (-1: none), `edges` (bins + 1,) are in the unit of the values.

    Per bin (bins,): `count` of samples, `mean_square` of what was binned, in its unit squared, and `centre`, the mean
    value.
    """

    index: Indices
    count: Indices
    mean_square: Array
    centre: Array
    edges: Array


def binned(values: Array, w: Array, most: int) -> Binned:
    """Return `w` (n,) in bins of about equal numbers of samples along `values` (n,), at most `most` bins; any units."""
    wanted = int(np.clip(values.size // ROWS_PER_BIN, 2, most))
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, wanted + 1)))
    inner = edges[1:-1]
    index = np.searchsorted(inner, values, side="right").astype(np.int64)
    count = np.bincount(index, minlength=inner.size + 1)
    # a value that half of all samples share can leave a bin empty
    full = count > 0
    index = (np.cumsum(full) - 1)[index]
    count = count[full]
    square = np.bincount(index, weights=w**2, minlength=count.size) / count
    centre = np.bincount(index, weights=values, minlength=count.size) / count
    lower = np.concatenate([edges[:1], inner])[full]
    return Binned(index.astype(np.int64), count, square, centre, np.concatenate([lower, edges[-1:]]))


def moving_rms(x: Array, length: int) -> Array:
    """Return the rms of `x` (n,) about its mean over `length` samples up to each sample, shape (n,).

    Samples to come answer this sample's noise where there is a loop.
    """
    length = min(length, x.size)
    squares = scipy.ndimage.uniform_filter1d((x - x.mean()) ** 2, length, mode="nearest", origin=(length - 1) // 2)
    return np.asarray(np.sqrt(np.maximum(squares, 0.0)))


def rate_of(x: Array, rate_hz: float) -> Array:
    """Return the rate of `x` (n,) up to each sample, shape (n,): in a loop, later ones respond to a sample's noise."""
    return np.diff(x, prepend=2.0 * x[0] - x[min(1, x.size - 1)]) * rate_hz


@njit
def accumulate(taps, index, w, parts, n_bins):  # type: ignore[no-untyped-def]
    """Return the normal equations (gram, cross) of `w` (n,) on the bins' indicators, whitened by `taps`.

    Only the few bins that a filter's memory touches are visited, so the cost does not grow with their number.
    """
    gram, cross = np.zeros((n_bins, n_bins)), np.zeros(n_bins)
    value, touched = np.zeros(n_bins), np.zeros(n_bins, dtype=np.int64)
    for p in range(parts.size - 1):
        for t in range(parts[p], parts[p + 1]):
            k = 0
            for lag in range(min(taps.size, t - parts[p] + 1)):
                b = index[t - lag]
                if b < 0:
                    continue
                known = False
                for j in range(k):
                    if touched[j] == b:
                        known = True
                        break
                if not known:
                    touched[k] = b
                    value[b] = 0.0
                    k += 1
                value[b] += taps[lag]
            for i in range(k):
                a = touched[i]
                cross[a] += value[a] * w[t]
                for j in range(k):
                    gram[a, touched[j]] += value[a] * value[touched[j]]
    return gram, cross


def mean_test(gram: Array, cross: Array, total: float, rows: int, noise_rows: int, *, free_mean: bool) -> float:
    """Return the p-value of "the mean is the same in all bins" (or zero, with `free_mean`) by an F test.

    `gram` (bins, bins) and `cross` (bins,) are products of the bins' columns with each other and with the residual.
    The noise's variance is 1, known from `noise_rows` samples; without any it is what the bins leave of `total`.
    """
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(gram / np.outer(scale, scale))
    keep = values > 1e-9 * values[-1]
    part = vectors[:, keep].T @ (cross / scale)
    explained, rank = float(np.sum(part**2 / values[keep])), int(keep.sum())
    rest, dof = total - explained, rows - rank
    if not free_mean:
        # a constant is the sum of all indicators
        size = float(gram.sum())
        explained -= float(cross.sum()) ** 2 / size if size > 0.0 else 0.0
        rank -= 1
    if rank < 1 or dof < 1:
        return 1.0
    noise = 1.0 if noise_rows else rest / dof
    return float(f_tail(max(explained, 0.0) / rank / noise, rank, noise_rows or dof))


def largest_test(ratio: Array, dof: Array, other_dof: Array) -> float:
    """Return the p-value of the most significant of n independent variance ratios.

    `ratio` (n,) follows F with `dof` over `other_dof` degrees of freedom, (n,) each, where variances are equal.
    """
    least = float(np.min(f_tail(ratio, dof, other_dof)))
    return float(-np.expm1(ratio.size * np.log1p(-min(least, 1.0 - 1e-16))))
