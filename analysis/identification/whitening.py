"""Filters that make a signal white, and whether what a fit leaves still answers to the inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from sim_backend.linear import Array

_LAGS = 20
"""Samples after which what is new in an input may show in what is new in an output."""

_CHANCE = 1e-6
"""How often noise may be taken for an answer."""

_LEAST = 1e-4
"""Least part of what is new in an output that counts: no filter whitens an excitation of a limited band."""


def whitening_filters(errors: Sequence[Array], order: int | None) -> Array:
    """Return the filter (n_y, p + 1) that whitens each output's error to unit variance, by Yule-Walker.

    With order None the Bayesian information criterion chooses it for each output, up to a twentieth of the samples
    and at most 30; shorter filters are filled with zeros.
    """
    n = sum(e.shape[0] for e in errors)
    most = min(30, n // 20) if order is None else order
    filters = []
    for o in range(errors[0].shape[1]):
        signals = [e[:, o] - e[:, o].mean() for e in errors]
        lags = np.array([sum(float(s[k:] @ s[: s.size - k]) for s in signals) / n for k in range(most + 1)])
        lags[0] = max(lags[0] * (1.0 + 1e-12), np.finfo(float).tiny)
        best: tuple[float, Array] | None = None
        for p in range(most + 1) if order is None else [most]:
            taps = (
                np.linalg.lstsq(scipy.linalg.toeplitz(lags[:p]), lags[1 : p + 1], rcond=1e-12)[0] if p else np.zeros(0)
            )
            power = max(lags[0] - float(taps @ lags[1 : p + 1]), np.finfo(float).tiny)
            score = n * np.log(power) + p * np.log(n)
            if best is None or score < best[0]:
                best = score, np.concatenate([[1.0], -taps, np.zeros(most - p)]) / np.sqrt(power)
        assert best is not None
        filters.append(best[1])
    found = np.array(filters)
    used = int(np.max(np.nonzero(np.any(found != 0.0, axis=0))[0])) + 1
    return found[:, :used]


def holds_inputs(errors: Sequence[Array], inputs: Sequence[Array]) -> bool:
    """Tell whether errors (n, n_y) hold what the inputs (n, n_u) of the same or earlier samples explain.

    A mode that a fit misses is absorbed by coloured noise, and a filter that whitens the errors leaves what drives the
    mode. So the innovations of the errors are compared with the innovations of the inputs.
    """
    white = [_new(errors, o) for o in range(errors[0].shape[1])]
    fresh = [_new(inputs, j) for j in range(inputs[0].shape[1]) if any(np.ptp(u[:, j]) > 0.0 for u in inputs)]
    rows = sum(e.shape[0] - _LAGS for e in errors)
    # the part of each that one input explains, which is that of one of as many squares by chance as there are lags
    least = max(scipy.stats.chi2.isf(_CHANCE / max(len(white) * len(fresh), 1), _LAGS + 1) / max(rows, 1), _LEAST)
    return any(_explained(e, w) > least for e in white for w in fresh)


def _new(signals: Sequence[Array], column: int) -> list[Array]:
    """Return what is new (n,) at each sample of one column of each signal."""
    own = [x[:, [column]] - x[:, column].mean() for x in signals]
    taps = whitening_filters(own, None)[0]
    return [scipy.signal.lfilter(taps, [1.0], x[:, 0]) for x in own]


def _explained(errors: Sequence[Array], inputs: Sequence[Array]) -> float:
    """Return the part of `errors` that a regression on the last samples of `inputs`, (n,) each, takes."""
    rows = [
        np.concatenate([np.lib.stride_tricks.sliding_window_view(u, _LAGS + 1), e[_LAGS:, None]], axis=1)
        for e, u in zip(errors, inputs, strict=True)
        if e.size > _LAGS
    ]
    if not rows:
        return 0.0
    products = sum(part.T @ part for part in rows)
    moment = products[:-1, -1]
    taken = float(moment @ np.linalg.lstsq(products[:-1, :-1], moment, rcond=1e-9)[0])
    return taken / max(float(products[-1, -1]), np.finfo(float).tiny)
