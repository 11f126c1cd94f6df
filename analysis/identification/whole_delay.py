"""The delay of a record's inputs in whole samples, found by regressions of a few taps that begin at each.

A regression of the outputs on their own past and on a few taps of an input explains most where its taps begin as the
plant does. That is a proposal, from any noise and any number of modes; a fit of modes to records without the delay
decides. Then no mode has to absorb it, and the remaining delay is a fraction of a sample.

Source: L. Ljung, System Identification, 2nd edition, 1999, sections 4.2 and 16.4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.regression import FRESH
from sim_backend.linear import Array

IntArray = NDArray[np.intp]

_ORDERS = (2, 4, 8, 16)
"""Lags of each signal: a regression of few may stop at what noise is, one of many at what it costs."""

LATEST = 64
"""Samples: more is not a delay of a drive's electronics; and columns of inputs that are solved at once."""

BEGINNING_ROWS = 20_000
"""Samples of the longest record from which a delay is determined."""


@dataclass(frozen=True)
class Beginning:
    """The sample `at` (n_u,) at which each input begins to act, by a regression of `order` lags of each signal.

    An input that acts at once and is held shows at the next sample: one.
    """

    at: IntArray
    order: int

    @property
    def whole(self) -> IntArray:
        """Whole samples of delay (n_u,) of a plant without feedthrough."""
        return np.maximum(self.at - 1, 0)


def beginning(inputs: Sequence[Array], outputs: Sequence[Array]) -> Beginning:
    """Return when the inputs of records (n, n_u) begin to act on the outputs (n, n_y), one input after the other.

    Records that are too short to tell are taken for those of a plant without a delay, and so is an input whose next
    sample follows from those before: where its taps begin is then any choice, and what moves with every amplitude of a
    plant that is not linear would be called a delay. A free delay is still fitted to it.
    """
    longest = max(range(len(inputs)), key=lambda i: inputs[i].shape[0])
    u, y = inputs[longest][:BEGINNING_ROWS], outputs[longest][:BEGINNING_ROWS]
    n, n_u, n_y = u.shape[0], u.shape[1], y.shape[1]
    orders = tuple(p for p in _ORDERS if 8 * p * (n_u + n_y) < n)
    latest = min(LATEST // n_u, n // 8)
    if not orders or latest < 2:
        return Beginning(np.ones(n_u, dtype=np.intp), _ORDERS[0])
    lags = _Lags(u, y, orders[-1], latest)
    common = min(
        ((p, k) for p in orders for k in range(latest)), key=lambda one: lags.criterion(one[0], [one[1]] * n_u)
    )
    order, late = common[0], [common[1]] * n_u
    for _ in range(2 if n_u > 1 else 0):
        for j in range(n_u):
            tried = [lags.criterion(order, [*late[:j], k, *late[j + 1 :]]) for k in range(latest)]
            late[j] = int(np.argmin(tried))
    told = [k if lags.fresh(j) >= FRESH else 1 for j, k in enumerate(late)]
    return Beginning(np.array(told, dtype=np.intp), order)


def freed(
    inputs: Sequence[Array], outputs: Sequence[Array], late: IntArray, unknown: int
) -> tuple[list[Array], list[Array]]:
    """Return the records with each input moved later by `late` (n_u,) samples, as the plant gets it.

    The first `unknown` samples are left out: what was played before a record is not known.
    """
    moved = [
        np.stack([u[unknown - k : u.shape[0] - k, j] for j, k in enumerate(late.tolist())], axis=1) for u in inputs
    ]
    return moved, [y[unknown:] for y in outputs]


class _Lags:
    """All lags of a record, orthogonalised once: any choice of them is then a small problem of least squares."""

    def __init__(self, u: Array, y: Array, order: int, latest: int) -> None:
        self._n_u, self._n_y, self._order = u.shape[1], y.shape[1], order
        past, n = order + latest, u.shape[0]
        columns = [y[past - k : n - k] for k in range(1, order + 1)]
        columns += [u[past - k : n - k] for k in range(past)]
        self._constant = order * self._n_y + past * self._n_u
        rows = np.hstack([*columns, np.ones((n - past, 1)), y[past:]])
        size = np.linalg.norm(rows, axis=0)
        self._rows = n - past
        self._r: Array = np.asarray(np.linalg.qr(rows / np.where(size > 0.0, size, 1.0), mode="r"))

    def fresh(self, j: int) -> float:
        """Return which part of an input's power is new in a sample, after all inputs before it."""
        first = self._order * self._n_y
        earlier = np.arange(first + self._n_u, self._constant + 1)
        goal = self._r[:, first + j]
        left = [
            goal - self._r[:, c] @ np.linalg.lstsq(self._r[:, c], goal, rcond=1e-12)[0]
            for c in ([self._constant], earlier)
        ]
        power, new = (float(np.sum(rest**2)) for rest in left)
        return new / power if power > 0.0 else 0.0

    def criterion(self, order: int, late: Sequence[int]) -> float:
        """Return the Bayesian criterion of a regression on `order` lags, those of each input from `late` on."""
        own = np.arange(order * self._n_y)
        first = self._order * self._n_y
        driven = [first + (late[j] + k) * self._n_u + j for k in range(order) for j in range(self._n_u)]
        columns = np.concatenate([own, np.array(driven, dtype=np.intp), [self._constant]])
        goal = self._r[:, self._constant + 1 :]
        rest = goal - self._r[:, columns] @ np.linalg.lstsq(self._r[:, columns], goal, rcond=1e-12)[0]
        power = np.maximum(np.sum(rest**2, axis=0), np.finfo(float).tiny)
        return float(self._rows * np.sum(np.log(power)) + columns.size * self._n_y * np.log(self._rows))
