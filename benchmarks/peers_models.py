"""Peers of `mccd identify` on the same rows: ARX by least squares, and N4SID of SIPPY (PyPI: sippy_unipi).

Both choose their numbers by what they foretell of the last quarter of the rows that may be fitted, in free run, and are
then fitted to all of those. The error on held-out rows is that of the state space from the best start, as for mccd.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

ARX_ORDERS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 16, 20, 25, 30)
ARX_DELAYS = tuple(range(16))
N4SID_ORDERS = (2, 3, 4, 6, 8, 10, 12, 16)
HORIZON = 25
"""Block rows of N4SID's past and future."""

CHECKED = 0.25
"""Part of the fitted rows, the last, on which the numbers are chosen."""

LONG = 20_000
"""Rows of a record on which N4SID's numbers are chosen: each fit takes seconds of more."""

START_ROWS = 20_000


@dataclass(frozen=True)
class StateSpace:
    """A discrete state space with what each output reads beside it; `words` says how it was made."""

    a: Array
    b: Array
    c: Array
    d: Array
    offset: Array
    words: str


def free_run_error(model: StateSpace, u: Array, y: Array, skip: int = 0) -> Array:
    """Return rms of the error over rms of the reading (n_y,), simulated from the start that meets the reading best."""
    order = model.a.shape[0]
    n, n_y = y.shape
    with np.errstate(all="ignore"):
        driven, state = np.empty((n, n_y)), np.zeros(order)
        free, power = np.empty((n, n_y, order)), model.c.copy()
        for k in range(n):
            driven[k] = model.c @ state + model.d @ u[k]
            free[k] = power
            state = model.a @ state + model.b @ u[k]
            power = power @ model.a
        rest = (y - model.offset - driven)[skip:]
        columns = free[skip:].reshape(-1, order)
        if not (np.all(np.isfinite(rest)) and np.all(np.isfinite(columns))):
            return np.full(n_y, np.inf)
        size = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
        some = slice(0, START_ROWS * n_y)
        start = np.linalg.lstsq((columns / size)[some], rest.ravel()[some], rcond=1e-9)[0] / size
        error = rest - (columns @ start).reshape(rest.shape)
    return np.sqrt(np.mean(error**2, axis=0)) / np.std(y[skip:], axis=0)


class _Regression:
    """All lags that an ARX may have, orthogonalised once; any choice of them is then a small problem."""

    def __init__(self, parts: Sequence[tuple[Array, Array]]) -> None:
        self.n_u, self.n_y = parts[0][0].shape[1], parts[0][1].shape[1]
        few = sum(u.shape[0] for u, _ in parts) // (4 * (self.n_u + self.n_y))
        self.orders = tuple(n for n in ARX_ORDERS if n <= few) or (1,)
        self.past = self.orders[-1] + ARX_DELAYS[-1]
        rows = np.concatenate([self._rows(u, y) for u, y in parts if u.shape[0] > self.past])
        self.count = rows.shape[0]
        self.r = cast(Array, np.linalg.qr(rows, mode="r"))

    def _rows(self, u: Array, y: Array) -> Array:
        n, p = u.shape[0], self.past
        lags = [y[p - k : n - k] for k in range(1, self.orders[-1] + 1)]
        lags += [u[p - k : n - k] for k in range(p + 1)]
        return np.hstack([*lags, np.ones((n - p, 1)), y[p:]])

    def solved(self, order: int, late: Sequence[int]) -> tuple[Array, float]:
        """Return the coefficients (k, n_y) of `order` lags of each signal, inputs `late` (n_u,), and the criterion."""
        own = np.arange(order * self.n_y)
        first = self.orders[-1] * self.n_y
        driven = [first + (late[j] + k) * self.n_u + j for k in range(order + 1) for j in range(self.n_u)]
        last = first + (self.past + 1) * self.n_u
        columns = np.r_[own, [i for i in driven if i < last], last].astype(int)
        goal = self.r[:, last + 1 :]
        found = np.asarray(np.linalg.lstsq(self.r[:, columns], goal, rcond=1e-12)[0], dtype=float)
        rest = goal - self.r[:, columns] @ found
        power = np.maximum(np.sum(rest**2, axis=0), np.finfo(float).tiny) / self.count
        return found, float(self.count * np.sum(np.log(power)) + 2.0 * found.size)

    def state_space(self, order: int, late: Sequence[int], found: Array) -> StateSpace:
        """Return the ARX as a state space of past outputs and past inputs."""
        n_u, n_y, past = self.n_u, self.n_y, order + max(late)
        a_k = found[: order * n_y].reshape(order, n_y, n_y).transpose(0, 2, 1)
        taps = np.zeros((past + 1, n_y, n_u))
        for k in range(order + 1):
            for j in range(n_u):
                taps[late[j] + k, :, j] = found[order * n_y + k * n_u + j]
        size_y, size_u = order * n_y, past * n_u
        a, b = np.zeros((size_y + size_u, size_y + size_u)), np.zeros((size_y + size_u, n_u))
        c = np.hstack([*a_k, *taps[1:]]) if past else np.hstack(list(a_k))
        a[:n_y], b[:n_y] = c, taps[0]
        a[n_y:size_y, : size_y - n_y] = np.eye(size_y - n_y)
        if past:
            b[size_y : size_y + n_u] = np.eye(n_u)
            a[size_y + n_u :, size_y : size_y + size_u - n_u] = np.eye(size_u - n_u)
        # the constant of the regression as a place of rest, where the poles leave one
        constant, balance = found[-1], np.eye(n_y) - a_k.sum(axis=0)
        offset = np.linalg.lstsq(balance, constant, rcond=1e-9)[0]
        return StateSpace(a, b, c, taps[0], offset, f"order {order}, late by {', '.join(map(str, late))}")


def _latest(some: _Regression, order: int) -> list[int]:
    """Return the delay of each input (n_u,) by the criterion, one input after the other."""
    late = [min(ARX_DELAYS, key=lambda k: some.solved(order, [k] * some.n_u)[1])] * some.n_u
    for j in range(some.n_u if some.n_u > 1 else 0):
        late[j] = min(ARX_DELAYS, key=lambda k: some.solved(order, [*late[:j], k, *late[j + 1 :]])[1])
    return late


def _checked(parts: Sequence[tuple[Array, Array]]) -> tuple[list[tuple[Array, Array]], list[tuple[Array, Array]]]:
    """Return the first rows, to fit, and the last ones, to choose by: whole parts where there are many."""
    if len(parts) > 3:
        kept = max(int(len(parts) * CHECKED), 1)
        return list(parts[:-kept]), list(parts[-kept:])
    cut = [int(u.shape[0] * (1.0 - CHECKED)) for u, _ in parts]
    return (
        [(u[:k], y[:k]) for (u, y), k in zip(parts, cut, strict=True)],
        [(u[k:], y[k:]) for (u, y), k in zip(parts, cut, strict=True)],
    )


def _worst(model: StateSpace, parts: Sequence[tuple[Array, Array]]) -> float:
    return float(np.max(np.mean([free_run_error(model, u, y) for u, y in parts], axis=0)))


def arx_models(parts: Sequence[tuple[Array, Array]]) -> Iterator[tuple[str, StateSpace]]:
    """Yield the ARX whose order Akaike's criterion chooses and the one that free run on the last fitted rows does."""
    first, last = _checked(parts)
    part, whole = _Regression(first), _Regression(parts)
    late = {n: _latest(part, n) for n in part.orders}
    by_criterion = min(part.orders, key=lambda n: whole.solved(n, late[n])[1])
    misses = {n: _worst(part.state_space(n, late[n], part.solved(n, late[n])[0]), last) for n in part.orders}
    for name, order in (("ARX by AIC", by_criterion), ("ARX by free run", min(misses, key=lambda n: misses[n]))):
        yield name, whole.state_space(order, late[order], whole.solved(order, late[order])[0])


def n4sid_models(parts: Sequence[tuple[Array, Array]]) -> Iterator[tuple[str, StateSpace]]:
    """Yield SIPPY's N4SID of the order that free run on the last fitted rows chooses, with the ARX's delays or none."""
    first, last = _checked([(u[:LONG], y[:LONG]) for u, y in parts])
    late = _latest(_Regression(first), 8)
    best: tuple[float, int, list[int]] | None = None
    for delays in [late, [0] * len(late)] if any(late) else [late]:
        for order in N4SID_ORDERS:
            model = _n4sid(first, order, delays)
            miss = np.inf if model is None else _worst(model, last)
            if best is None or miss < best[0]:
                best = miss, order, delays
    assert best is not None
    chosen = _n4sid(parts, *best[1:])
    if chosen is not None:
        yield "N4SID (SIPPY)", chosen


def _n4sid(parts: Sequence[tuple[Array, Array]], order: int, late: Sequence[int]) -> StateSpace | None:
    """Return SIPPY's model of the parts one after the other, inputs shifted by `late` (n_u,), None where it fails."""
    from sippy_unipi import system_identification

    keep = max(late)
    u = np.concatenate([_shifted(x, late)[keep:] for x, _ in parts])
    y = np.concatenate([x[keep:] for _, x in parts])
    mean_u, mean_y = u.mean(axis=0), y.mean(axis=0)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            found = system_identification(
                (y - mean_y).T, (u - mean_u).T, "N4SID", SS_fixed_order=order, SS_f=HORIZON, SS_D_required=True
            )
    except (ValueError, np.linalg.LinAlgError, scipy.linalg.LinAlgError):
        return None
    a, b, c, d = (np.asarray(getattr(found, key), dtype=float) for key in ("A", "B", "C", "D"))
    gain = c @ np.linalg.lstsq(np.eye(a.shape[0]) - a, b, rcond=1e-9)[0] + d
    words = f"order {order}, late by {', '.join(map(str, late))}"
    return _behind(StateSpace(a, b, c, d, mean_y - gain @ mean_u, words), late)


def _behind(model: StateSpace, late: Sequence[int]) -> StateSpace:
    """Return the model with its inputs' delays as states of their own."""
    a, b, c, d = model.a, model.b, model.c, model.d
    for j, delay in enumerate(late):
        for _ in range(delay):
            n = a.shape[0]
            a = np.block([[a, b[:, [j]]], [np.zeros((1, n + 1))]])
            c = np.hstack([c, d[:, [j]]])
            b, d = np.vstack([b, np.zeros((1, b.shape[1]))]), d.copy()
            b[:, j], d[:, j] = 0.0, 0.0
            b[n, j] = 1.0
    return StateSpace(a, b, c, d, model.offset, model.words)


def _shifted(u: Array, late: Sequence[int]) -> Array:
    return np.stack([np.r_[np.zeros(k), u[: u.shape[0] - k, j]] for j, k in enumerate(late)], axis=1)
