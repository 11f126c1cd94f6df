"""Linear simulation of a DiscreteModel: block by block in compiled code, or all at once for a periodic input.

A recursion has to wait for each of its products, and a processor could do a dozen meanwhile. So a record is cut into
stretches that are played from rest, all at once; what each one's first state swings on to is added, for the model is
linear.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from sim_backend.errors import ConfigError
from sim_backend.jit import njit
from sim_backend.linear import Array, DiscreteModel, delay_taps

# a pass takes a few samples of many stretches at a time, so that these stay in the processor's nearest caches; a
# length of a power of two would put all stretches into the same few addresses of a cache
_LANES, _STRETCH, _ROWS = 64, 136, 68


@njit
def recur(a: Array, drive: Array, x: Array) -> None:
    """Convert each block's drive (m, 2, n) to its states (q, v) in place; `x` (m, 2) is the state before and after."""
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


@dataclass(frozen=True)
class Driven:
    """What drives a model: `forces` (n, k), and how they enter its states, `b` (m, 2, k), and outputs, `d` (n_y, k)."""

    forces: Array
    b: Array
    d: Array


def driven_by(model: DiscreteModel, u: Array) -> Driven:
    """Return what commands `u` (n, n_u) drive a model by after its delays.

    Where these are split, every command drives it twice: by the sample that comes in, and by the one before it.
    """
    late = model.delay_samples
    if model.late is None:
        return Driven(delayed(u, late), model.b, model.d)
    whole = np.floor(late)
    forces = np.concatenate([delayed(u, whole), delayed(u, whole + 1.0)], axis=1)
    newer = np.where(late > whole, 0.0, model.d)  # within a sample its first instant counts
    b = np.concatenate([model.b - model.late, model.late], axis=2)
    return Driven(forces, b, np.concatenate([newer, model.d - newer], axis=1))


@njit(fastmath={"contract"})
def _respond_from_rest(a: Array, b: Array, c: Array, u: Array, x: Array, y: Array, first: int, last: int) -> None:
    """Add one block's response to the samples from `first` to `last` of `y` (n_y, stretch, lanes).

    It is driven by the first samples of `u` (n_u, rows, lanes), and its states `x` (2 lanes) are advanced. `a` (2, 2),
    `b` (2, n_u), `c` (n_y, 2). All lanes are stepped together, as they do not depend on each other: one chain of states
    would have to wait for every product. Rates follow all positions in one row, so that the compiler sees that they do
    not overlap. The first output and input that the block has are included in its step.
    """
    n, a00, a01, a10, a11 = _LANES, a[0, 0], a[0, 1], a[1, 0], a[1, 1]
    first_out, first_in = _first(c[:, 0], c[:, 1]), _first(b[0], b[1])
    c0, c1, b0, b1 = c[first_out, 0], c[first_out, 1], b[0, first_in], b[1, first_in]
    for k in range(last - first):
        for i in range(first_out + 1, c.shape[0]):
            if c[i, 0] != 0.0 or c[i, 1] != 0.0:
                other, o0, o1 = y[i, first + k], c[i, 0], c[i, 1]
                for s in range(n):
                    other[s] += o0 * x[s] + o1 * x[n + s]
        at, drive = y[first_out, first + k], u[first_in, k]
        for s in range(n):
            q, v, push = x[s], x[n + s], drive[s]
            at[s] += c0 * q + c1 * v
            x[s] = a00 * q + (a01 * v + b0 * push)
            x[n + s] = a10 * q + (a11 * v + b1 * push)
        for j in range(first_in + 1, b.shape[1]):
            if b[0, j] != 0.0 or b[1, j] != 0.0:
                drive, p0, p1 = u[j, k], b[0, j], b[1, j]
                for s in range(n):
                    x[s] += p0 * drive[s]
                    x[n + s] += p1 * drive[s]


@njit
def _first(one: Array, other: Array) -> int:
    """Return where one of both is not zero for the first time, 0 if nowhere."""
    for i in range(one.size):
        if one[i] != 0.0 or other[i] != 0.0:
            return i
    return 0


@njit(fastmath={"contract"})
def _add_swing(a: Array, c: Array, x: Array, y: Array, first: int, last: int) -> None:
    """Add one block's swing from the states `x` (2 lanes) to the samples from `first` to `last` of `y`.

    `c` (n_y, 2) is moved on by as many samples.
    """
    n = _LANES
    for i in range(c.shape[0]):
        c0, c1 = c[i, 0], c[i, 1]
        if c0 == 0.0 and c1 == 0.0:
            continue
        for k in range(first, last):
            at = y[i, k]
            for s in range(n):
                at[s] += c0 * x[s] + c1 * x[n + s]
            c0, c1 = c0 * a[0, 0] + c1 * a[1, 0], c0 * a[0, 1] + c1 * a[1, 1]
        c[i, 0], c[i, 1] = c0, c1


@njit
def _spread(drive: Array, start: int, stretch: int, u: Array, first: int, last: int) -> None:
    """Fill the first samples of `u` with samples `first` to `last` of all stretches of `drive` (n, n_u) from `start`.

    Beyond the end there is nothing.
    """
    for j in range(u.shape[0]):
        for s in range(_LANES):
            begin = start + s * stretch + first
            there = max(min(drive.shape[0] - begin, last - first), 0)
            for k in range(there):
                u[j, k, s] = drive[begin + k, j]
            for k in range(there, last - first):
                u[j, k, s] = 0.0


@njit
def _gather(y: Array, first: int, last: int, out: Array, start: int) -> None:
    """Copy samples `first` to `last` of all stretches of `y` to their position in `out` (n, n_y) from `start`."""
    for i in range(y.shape[0]):
        for s in range(_LANES):
            begin = start + s * y.shape[1] + first
            for k in range(max(min(out.shape[0] - begin, last - first), 0)):
                out[begin + k, i] = y[i, first + k, s]


@njit
def _put_direct(d: Array, u: Array, y: Array, first: int, last: int) -> None:
    """Fill the samples from `first` to `last` of `y` with `d` (n_y, n_u) times the first samples of `u`.

    Number by number: for an array that is written to another one numba compiles the text of an error about their
    shapes as well, which takes 4 s.
    """
    for i in range(d.shape[0]):
        for k in range(first, last):
            row = y[i, k]
            for s in range(row.size):
                row[s] = 0.0
            for j in range(d.shape[1]):
                if d[i, j] != 0.0:
                    drive = u[j, k - first]
                    for s in range(row.size):
                        row[s] += d[i, j] * drive[s]


@njit
def _respond(
    a: Array, over: Array, stretch: int, b: Array, c: Array, d: Array, drive: Array, state: Array, out: Array
) -> None:
    """Fill `out` (n, n_y) with the response to `drive` (n, n_u); `state` (m, 2) is that before and after.

    Each pass plays all its stretches from rest at once and adds what each one's first state swings on to. `over` (m, 2,
    2) is `a` over a stretch of so many samples. All blocks take their turn at a few samples, which stay in the nearest
    cache.
    """
    n, n_u, n_y, m = drive.shape[0], drive.shape[1], out.shape[1], a.shape[0]
    u, y, x = np.empty((n_u, _ROWS, _LANES)), np.empty((n_y, stretch, _LANES)), np.empty((m, 2 * _LANES))
    for start in range(0, n, _LANES * stretch):
        x[:] = 0.0
        for first in range(0, stretch, _ROWS):
            last = min(first + _ROWS, stretch)
            _spread(drive, start, stretch, u, first, last)
            _put_direct(d, u, y, first, last)
            for block in range(m):
                _respond_from_rest(a[block], b[block], c[block], u, x[block], y, first, last)
        for block in range(m):
            q, v, ends = state[block, 0], state[block, 1], x[block]
            for s in range(_LANES):
                from_rest_q, from_rest_v = ends[s], ends[_LANES + s]
                ends[s], ends[_LANES + s] = q, v
                q, v = (
                    over[block, 0, 0] * q + over[block, 0, 1] * v + from_rest_q,
                    over[block, 1, 0] * q + over[block, 1, 1] * v + from_rest_v,
                )
            state[block, 0], state[block, 1] = q, v
        seen = c.copy()
        for first in range(0, stretch, _ROWS):
            last = min(first + _ROWS, stretch)
            for block in range(m):
                _add_swing(a[block], seen[block], x[block], y, first, last)
            _gather(y, first, last, out, start)


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
    driven = driven_by(model, np.asarray(u, dtype=float))
    stretch = max(min(_STRETCH, -(-u.shape[0] // _LANES)), 1)
    c = np.ascontiguousarray(model.c.swapaxes(0, 1))
    seen = np.any(c != 0.0, axis=(1, 2))
    a, b = model.a[seen], driven.b[seen]
    drive = np.ascontiguousarray(driven.forces)
    _respond(a, np.linalg.matrix_power(a, stretch), stretch, b, c[seen], driven.d, drive, state[seen], out)
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
