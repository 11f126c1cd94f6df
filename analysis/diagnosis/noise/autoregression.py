"""The colour of a noise by autoregression: the shortest filter whose output is unpredictable."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.noise.whitener import Mask
from sim_backend.linear import Array

MAX_ORDER = 40
"""Largest order of the noise filter in samples; longer correlation is described by the levels of its bands."""


def fit_ar(parts: list[tuple[Array, Mask]], max_order: int = MAX_ORDER) -> Array:
    """Return the whitening taps (order + 1,) of one autoregression of several series.

    `parts` are pairs of a series and the mask of its valid samples, (n,) each.

    Least squares over all samples at once (covariance method, which also suits near-unit roots), order by BIC; the
    first tap is the inverse of the innovations' standard deviation.
    """
    p = max(min(max_order, min(x.size for x, _ in parts) // 10), 0)
    normal = np.zeros((p + 1, p + 1))
    rows = 0
    for x, mask in parts:
        if x.size <= p or not np.any(x):
            continue
        lags = np.lib.stride_tricks.sliding_window_view(x, p + 1)[mask[p:]][:, ::-1]
        normal += lags.T @ lags
        rows += lags.shape[0]
    best, best_score = np.ones(1), np.inf
    for order in range(p + 1):
        inner = normal[1 : order + 1, 1 : order + 1]
        ridge = 1e-12 * np.trace(inner) / max(order, 1)
        if rows == 0:
            break
        weights = np.linalg.solve(inner + ridge * np.eye(order), normal[1 : order + 1, 0]) if order else np.zeros(0)
        rss = float(normal[0, 0] - weights @ normal[1 : order + 1, 0])
        if rss <= 0.0:
            continue
        score = rows * np.log(rss / rows) + order * np.log(rows)
        if score < best_score - 1e-9:
            best_score = score
            best = np.concatenate([[1.0], -weights]) / np.sqrt(rss / rows)
    return best
