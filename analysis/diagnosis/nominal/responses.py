"""Linear responses by block recursion, compiled: the filter that takes every signature to the outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.linear.simulate import Driven, driven_by
from sim_backend.jit import njit
from sim_backend.linear import Array, DiscreteModel


@njit
def _mode(a, b, c, f, start, scale, out):  # type: ignore[no-untyped-def]
    """Add to `out` (n, n_y) `scale` times what one block gives that begins at `start` (2,) under forces `f` (n, n_u).

    b is (2, n_u), c (n_y, 2).
    """
    a00, a01, a10, a11 = a[0, 0], a[0, 1], a[1, 0], a[1, 1]
    x0, x1 = start[0], start[1]
    for k in range(out.shape[0]):
        for i in range(c.shape[0]):
            out[k, i] += scale * (c[i, 0] * x0 + c[i, 1] * x1)
        x0, x1 = a00 * x0 + a01 * x1, a10 * x0 + a11 * x1
        for j in range(f.shape[1]):
            x0 += b[0, j] * f[k, j]
            x1 += b[1, j] * f[k, j]


@njit
def _propagate(a, b, c, d, f, out):  # type: ignore[no-untyped-def]
    """Add to `out` (n, n_y) the response of all blocks to one input `f` (n,): b (m, 2), c (n_y, m, 2), d (n_y,).

    Outputs that do not move are not touched: memory that nobody has written costs nothing.
    """
    n_y = out.shape[1]
    for i in range(n_y):
        if d[i] != 0.0:
            for k in range(f.size):
                out[k, i] += d[i] * f[k]
    for m in range(a.shape[0]):
        if b[m, 0] == 0.0 and b[m, 1] == 0.0:
            continue
        a00, a01, a10, a11, b0, b1 = a[m, 0, 0], a[m, 0, 1], a[m, 1, 0], a[m, 1, 1], b[m, 0], b[m, 1]
        moved = np.empty(n_y, np.int64)
        n_moved = 0
        for i in range(n_y):
            if c[i, m, 0] != 0.0 or c[i, m, 1] != 0.0:
                moved[n_moved] = i
                n_moved += 1
        x0, x1 = 0.0, 0.0
        for k in range(f.size):
            for i in moved[:n_moved]:
                out[k, i] += c[i, m, 0] * x0 + c[i, m, 1] * x1
            force = f[k]
            x0, x1 = a00 * x0 + a01 * x1 + b0 * force, a10 * x0 + a11 * x1 + b1 * force


def response(
    model: DiscreteModel, force: Array, input_index: int, *, through_delay: bool = False, out: Array | None = None
) -> Array:
    """Return the outputs (n, n_y) to `force` (n,) at one input, from rest; added to `out` where it is given.

    A force on the structure does not pass the input's delay; a command does (`through_delay`).
    """
    one = [input_index]
    driven = Driven(force[:, None], model.b[:, :, one], model.d[:, one])
    if through_delay:
        late = None if model.late is None else model.late[:, :, one]
        alone = replace(model, b=driven.b, d=driven.d, delay_samples=model.delay_samples[one], late=late)
        driven = driven_by(alone, driven.forces)
    out = np.zeros((force.size, model.c.shape[0])) if out is None else out
    for j in range(driven.forces.shape[1]):
        b, d, f = (np.ascontiguousarray(x) for x in (driven.b[:, :, j], driven.d[:, j], driven.forces[:, j]))
        _propagate(model.a, b, model.c, d, f, out)
    return out


def simulate(model: DiscreteModel, u: Array, *, through_delay: bool = True) -> Array:
    """Return the outputs (n, n_y) to commands (or torques, without `through_delay`) `u` (n, n_u) from rest."""
    out = np.zeros((u.shape[0], model.c.shape[0]))
    for j in range(u.shape[1]):
        out += response(model, u[:, j], j, through_delay=through_delay)
    return out


def coasting(model: DiscreteModel, start: Array, n: int) -> Array:
    """Return the outputs (n, n_y) that the states `start` (m, 2) give on their own, m being at most the model's."""
    out, unforced = np.zeros((n, model.c.shape[0])), np.zeros((n, 0))
    for i in np.flatnonzero(np.any(start != 0.0, axis=1)):
        _mode(model.a[i], model.b[i, :, :0], model.c[:, i], unforced, start[i], 1.0, out)
    return out


def contrast(there: DiscreteModel, back: DiscreteModel, u: Array, start: Array) -> Array:
    """Return how much more one mode gives than another, (n, n_y), both from `start` (2,) under torques `u` (n, n_u).

    Each output is one stretch of memory. Both models have this one mode and no direct term.
    """
    series = np.zeros((there.c.shape[0], u.shape[0]))
    for model, sign in ((there, 1.0), (back, -1.0)):
        _mode(model.a[0], model.b[0], model.c[:, 0], u, start, sign, series.T)
    return series.T


def no_columns(outputs: Array, k: int) -> Array:
    """Return columns of zeros (n, n_y, k) for `outputs` (n, n_y), to be filled: each of each output is one stretch."""
    return np.zeros((k, *outputs.shape[::-1])).T


def stacked(columns: Sequence[Array]) -> Array:
    """Return columns (n, n_y) side by side, (n, n_y, k): each of each output is one stretch of memory."""
    return np.stack([column.T for column in columns]).T


def free_responses(model: DiscreteModel, n: int) -> Array:
    """Return the outputs to unit initial states, shape (n, n_y, 2 m): what a record's unknown start can add.

    Each column of each output is one stretch of memory.
    """
    m, n_y = model.a.shape[0], model.c.shape[0]
    series, unforced = np.zeros((2 * m, n_y, n)), np.zeros((n, 0))
    for i in range(m):
        for k, unit in enumerate(np.eye(2)):
            _mode(model.a[i], model.b[i, :, :0], model.c[:, i], unforced, unit, 1.0, series[2 * i + k].T)
    return series.T


def waiting_at(model: DiscreteModel) -> list[int]:
    """Return how many commands of each input are within its delay at any time; the youngest may have acted in part.

    A fraction of a sample is split between two commands, or is interpolated from the four nearest.
    """
    return [int(np.ceil(late)) + int(late > np.floor(late)) if late > 0.0 else 0 for late in model.delay_samples]


def answers_to_before(model: DiscreteModel, n: int) -> Array:
    """Return the outputs to a unit command at each input in each sample before the first that is within its delay.

    Shape (n, n_y, k), none without delays: what a record's unknown start can add beside the states of the modes.
    """
    columns = [np.zeros((n, model.c.shape[0], 0))]
    for j, before in enumerate(waiting_at(model)):
        for k in range(before):
            command = np.zeros(n + before)
            command[k] = 1.0
            columns.append(response(model, command, j, through_delay=True)[before:, :, None])
    return np.concatenate(columns, axis=2)
