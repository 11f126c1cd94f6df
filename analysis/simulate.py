"""Linear simulation of a DiscreteModel: block by block in compiled code, or all at once for a periodic input."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import fft

from sim_backend.errors import ConfigError
from sim_backend.linear import Array, DiscreteModel

# samples per pass: the states of a few blocks over this many samples stay in the processor's cache
_CHUNK = 4096


@njit(cache=True, nogil=True)
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


def delayed(u: Array, delay_samples: Array) -> Array:
    """Return the input (n, n_u) later by `delay_samples` (n_u,), zero before its start.

    A fraction of a sample is a straight line between two held samples, as in sim_backend.linear.
    """
    if not np.any(delay_samples):
        return u
    out = np.zeros_like(u)
    for j, delay in enumerate(delay_samples):
        whole = min(int(np.floor(delay)), u.shape[0])
        part = delay - whole
        out[whole:, j] = (1.0 - part) * u[: u.shape[0] - whole, j]
        out[whole + 1 :, j] += part * u[: max(u.shape[0] - whole - 1, 0), j]
    return out


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
    n_y = model.c.shape[0]
    y = np.empty((u.shape[0], n_y))
    drive = delayed(np.asarray(u, dtype=float), model.delay_samples)
    into, out = model.b.reshape(2 * m, n_u), model.c.reshape(n_y, 2 * m)
    for k in range(0, u.shape[0], _CHUNK):
        part = np.ascontiguousarray(drive[k : k + _CHUNK].T)
        states = (into @ part).reshape(m, 2, -1)
        recur(model.a, states, state)
        y[k : k + _CHUNK] = (out @ states.reshape(2 * m, -1) + model.d @ part).T
    return y


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
    spectrum = fft.rfft(u, axis=0)
    out = np.einsum("fyu,fu...->fy...", response, spectrum)
    return fft.irfft(out, n, axis=0)
