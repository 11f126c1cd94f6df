"""Linear simulation of a DiscreteModel: block by block in compiled code, or all at once for a periodic input.

A recursion has to wait for each of its products, and a processor could do a dozen meanwhile. So a record is cut into
stretches that are played from rest, all at once; what each one's first state swings on to is added, for the model is
linear.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from sim_backend.errors import ConfigError
from sim_backend.jit import njit
from sim_backend.linear import Array, DiscreteModel, delay_taps

# a pass takes so many stretches of so many samples: what it needs of them stays in the processor's cache
_LANES, _STRETCH = 64, 128


@njit
def recur(a: Array, drive: Array, x: Array) -> None:
    """Turn each block's drive (m, 2, n) into its states (q, v) in place; `x` (m, 2) is the state before and after."""
    m, _, n = drive.shape
    for i in range(m):
        q, v = x[i, 0], x[i, 1]
        a00, a01, a10, a11 = a[i, 0, 0], a[i, 0, 1], a[i, 1, 0], a[i, 1, 1]
        for k in range(n):
            next_q = a00 * q + (a01 * v + drive[i, 0, k])
            next_v = a10 * q + (a11 * v + drive[i, 1, k])
            drive[i, 0, k], drive[i, 1, k] = q, v
            q, v = next_q, next_v
        x[i, 0], x[i, 1] = q, v


def weighted(u: Array, first: int, weights: Array) -> Array:
    """Return the sum of `weights` times the input (n,) of `first` samples ago and of the samples before that."""
    out = np.zeros(u.size)
    for late, weight in enumerate(weights, start=first):
        if late < u.size:
            out[late:] += weight * u[: u.size - late]
    return out


def delayed(u: Array, delay_samples: Array) -> Array:
    """Return the input (n, n_u) later by `delay_samples` (n_u,), zero before its start: see linear.delay_taps."""
    if not np.any(delay_samples):
        return u
    out = np.zeros_like(u)
    for j, delay in enumerate(delay_samples):
        taps = delay_taps(float(delay))
        out[:, j] = weighted(u[:, j], taps.first, taps.weights)
    return out


@njit
def _respond_from_rest(a: Array, b: Array, c: Array, u: Array, x: Array, y: Array) -> None:
    """Add one block's response from rest to `y` (n_y, stretch, lanes), for `u` alike; `x` (2, lanes) is its end.

    `a` (2, 2), `b` (2, n_u), `c` (n_y, 2). All lanes are stepped together, as they do not depend on each other: one
    chain of states would have to wait for every product.
    """
    a00, a01, a10, a11 = a[0, 0], a[0, 1], a[1, 0], a[1, 1]
    q, v = x[0], x[1]
    q[:], v[:] = 0.0, 0.0
    for k in range(u.shape[1]):
        for i in range(c.shape[0]):
            if c[i, 0] != 0.0 or c[i, 1] != 0.0:
                at, c0, c1 = y[i, k], c[i, 0], c[i, 1]
                for s in range(q.size):
                    at[s] += c0 * q[s] + c1 * v[s]
        for s in range(q.size):
            q[s], v[s] = a00 * q[s] + a01 * v[s], a10 * q[s] + a11 * v[s]
        for j in range(b.shape[1]):
            if b[0, j] != 0.0 or b[1, j] != 0.0:
                drive, b0, b1 = u[j, k], b[0, j], b[1, j]
                for s in range(q.size):
                    q[s] += b0 * drive[s]
                    v[s] += b1 * drive[s]


@njit
def _add_swing(a: Array, c: Array, x: Array, y: Array) -> None:
    """Add one block's swing from the states `x` (2, lanes) to `y` (n_y, stretch, lanes)."""
    q, v = x[0], x[1]
    for i in range(c.shape[0]):
        c0, c1 = c[i, 0], c[i, 1]
        if c0 == 0.0 and c1 == 0.0:
            continue
        for k in range(y.shape[1]):
            at = y[i, k]
            for s in range(q.size):
                at[s] += c0 * q[s] + c1 * v[s]
            c0, c1 = c0 * a[0, 0] + c1 * a[1, 0], c0 * a[0, 1] + c1 * a[1, 1]


@njit
def _add_direct(d: Array, u: Array, y: Array) -> None:
    """Add `d` (n_y, n_u) times `u` (n_u, stretch, lanes) to `y` (n_y, stretch, lanes).

    Number by number: for an array that is written to another one numba compiles the text of an error about their
    shapes as well, which takes 4 s.
    """
    for i in range(d.shape[0]):
        for j in range(d.shape[1]):
            if d[i, j] != 0.0:
                for k in range(y.shape[1]):
                    row, drive = y[i, k], u[j, k]
                    for s in range(row.size):
                        row[s] += d[i, j] * drive[s]


@njit
def _respond(
    a: Array, over: Array, stretch: int, b: Array, c: Array, d: Array, drive: Array, state: Array, out: Array
) -> None:
    """Fill `out` (n, n_y) with the response to `drive` (n, n_u); `state` (m, 2) is that before and after.

    Each pass plays all its stretches from rest at once and adds what each one's first state swings on to. `over` (m, 2,
    2) is `a` over a stretch of so many samples.
    """
    n, n_u, n_y = drive.shape[0], drive.shape[1], out.shape[1]
    u, y, x = np.zeros((n_u, stretch, _LANES)), np.empty((n_y, stretch, _LANES)), np.empty((2, _LANES))
    for start in range(0, n, _LANES * stretch):
        whole = min(n - start, _LANES * stretch)
        for j in range(n_u):
            for k in range(stretch):
                row = u[j, k]
                for s in range(_LANES):
                    at = s * stretch + k
                    row[s] = drive[start + at, j] if at < whole else 0.0
        y[:] = 0.0
        _add_direct(d, u, y)
        for m in range(a.shape[0]):
            _respond_from_rest(a[m], b[m], c[m], u, x, y)
            q, v = state[m, 0], state[m, 1]
            for s in range(_LANES):
                from_rest_q, from_rest_v = x[0, s], x[1, s]
                x[0, s], x[1, s] = q, v
                q, v = (
                    over[m, 0, 0] * q + over[m, 0, 1] * v + from_rest_q,
                    over[m, 1, 0] * q + over[m, 1, 1] * v + from_rest_v,
                )
            state[m, 0], state[m, 1] = q, v
            _add_swing(a[m], c[m], x, y)
        for i in range(n_y):
            for k in range(stretch):
                row = y[i, k]
                for s in range(_LANES):
                    if s * stretch + k < whole:
                        out[start + s * stretch + k, i] = row[s]


def simulate_linear(model: DiscreteModel, u: Array, x0: Array | None = None) -> Array:
    """Return the output (n, n_y) for an input (n, n_u) sampled at the model's rate.

    `x0` (m, 2) are the states (q, v) of each block at the first sample, zero if not given. Raises ConfigError when a
    shape does not fit.
    """
    m, n_u = model.a.shape[0], model.b.shape[2]
    if u.ndim != 2 or u.shape[1] != n_u:
        raise ConfigError(f"input has shape {u.shape}; the model needs (n, {n_u})")
    if x0 is not None and x0.shape != (m, 2):
        raise ConfigError(f"initial state has shape {x0.shape}; the model needs ({m}, 2)")
    state = np.zeros((m, 2)) if x0 is None else np.array(x0, dtype=float)
    out = np.empty((u.shape[0], model.c.shape[0]))
    drive = np.ascontiguousarray(delayed(np.asarray(u, dtype=float), model.delay_samples))
    stretch = max(min(_STRETCH, -(-u.shape[0] // _LANES)), 1)
    over = np.linalg.matrix_power(model.a, stretch)
    c = np.ascontiguousarray(model.c.swapaxes(0, 1))
    _respond(np.ascontiguousarray(model.a), over, stretch, np.ascontiguousarray(model.b), c, model.d, drive, state, out)
    return out


def periodic_response(response: NDArray[np.complex128], u: Array) -> Array:
    """Return the steady-state output of a periodic input from a frequency response on its own lines.

    Shapes: `response` (n // 2 + 1, n_y, n_u) at the frequencies of `rfft`; `u` (n, n_u, …), one period along the first
    axis. The lines at 0 Hz and half the rate are real by nature; the imaginary part of the response is dropped there.
    Raises ConfigError when the lengths do not fit.
    """
    n = u.shape[0]
    if response.shape[0] != n // 2 + 1 or response.shape[2] != u.shape[1]:
        raise ConfigError(
            f"response has shape {response.shape}; a period of shape {u.shape} needs ({n // 2 + 1}, n_y, {u.shape[1]})"
        )
    spectrum = scipy.fft.rfft(u, axis=0)
    out = np.einsum("fyu,fu...->fy...", response, spectrum)
    return scipy.fft.irfft(out, n, axis=0)
