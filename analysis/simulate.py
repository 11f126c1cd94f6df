"""Linear simulation of a DiscreteModel: block by block in compiled code, or all at once for a periodic input."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy import fft

from sim_backend.errors import ConfigError
from sim_backend.linear import Array, DiscreteModel


@njit(cache=True, nogil=True)
def _run(a, b, c, d, u, x, y):
    """Step all blocks through the samples; `x` (m, 2) holds the states before and after."""
    n, n_u = u.shape
    m, n_y = a.shape[0], c.shape[0]
    for k in range(n):
        for o in range(n_y):
            total = 0.0
            for j in range(n_u):
                total += d[o, j] * u[k, j]
            y[k, o] = total
        for i in range(m):
            q, v = x[i, 0], x[i, 1]
            for o in range(n_y):
                y[k, o] += c[o, i, 0] * q + c[o, i, 1] * v
            next_q = a[i, 0, 0] * q + a[i, 0, 1] * v
            next_v = a[i, 1, 0] * q + a[i, 1, 1] * v
            for j in range(n_u):
                next_q += b[i, 0, j] * u[k, j]
                next_v += b[i, 1, j] * u[k, j]
            x[i, 0], x[i, 1] = next_q, next_v


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
    y = np.empty((u.shape[0], model.c.shape[0]))
    drive = np.ascontiguousarray(delayed(np.asarray(u, dtype=float), model.delay_samples))
    _run(model.a, model.b, model.c, model.d, drive, state, y)
    return y


def periodic_response(response: Array, u: Array) -> Array:
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
