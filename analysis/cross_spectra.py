"""Response of several experiments at every frequency by instrumental variables, in one compiled pass over the spectra.

At each frequency G = (Y W')(U W')^-1 over the experiments, with the instrument W = U in open loop. With residual
V = Y - G U, E|error of G[y, u]|² = E|V[y]|² · S[u, u], where S = (U W')^-1 (W W') (U W')^-H, if the experiments'
errors are independent. Distortion of orthogonal multisines is not independent within a block of n_u experiments, so
blocks are also solved one by one.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@njit(cache=True, nogil=True)
def _invert(matrix: ComplexArray, inverse: ComplexArray) -> bool:
    """Gauss-Jordan with row pivots of a small matrix (overwritten) into `inverse`; returns False when singular."""
    n = matrix.shape[0]
    inverse[:] = 0.0
    largest = 0.0
    for i in range(n):
        inverse[i, i] = 1.0
        for j in range(n):
            largest = max(largest, abs(matrix[i, j]))
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        if abs(matrix[pivot, k]) <= 1e-13 * largest:
            return False
        if pivot != k:
            for j in range(n):
                matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
                inverse[k, j], inverse[pivot, j] = inverse[pivot, j], inverse[k, j]
        factor = 1.0 / matrix[k, k]
        for j in range(n):
            matrix[k, j] *= factor
            inverse[k, j] *= factor
        for i in range(n):
            if i != k:
                factor = matrix[i, k]
                for j in range(n):
                    matrix[i, j] -= factor * matrix[k, j]
                    inverse[i, j] -= factor * inverse[k, j]
    return True


@njit(cache=True, nogil=True)
def _means(data: ComplexArray, out: ComplexArray) -> None:
    """Average (channel, experiment, period) over the periods into (channel, experiment)."""
    n_c, n_e, n_p = data.shape
    for c in range(n_c):
        for e in range(n_e):
            total = 0.0j
            for p in range(n_p):
                total += data[c, e, p]
            out[c, e] = total / n_p


@njit(cache=True, nogil=True)
def _solve_line(
    u: ComplexArray,
    y: ComplexArray,
    w: ComplexArray,
    g: ComplexArray,
    shape: Array,
    work: ComplexArray,
    inverse: ComplexArray,
) -> bool:
    """Solve one line from averaged spectra (channel, experiment); returns False when the inputs are not separate."""
    n_u, n_e, n_y = u.shape[0], u.shape[1], y.shape[0]
    for i in range(n_u):
        for j in range(n_u):
            total = 0.0j
            for e in range(n_e):
                total += u[i, e] * w[j, e].conjugate()
            work[i, j] = total
    if not _invert(work, inverse):
        return False
    for i in range(n_y):
        for j in range(n_u):
            total = 0.0j
            for e in range(n_e):
                # row e of W' (U W')^-1 is the weight of experiment e in each column of G
                weight = 0.0j
                for k in range(n_u):
                    weight += w[k, e].conjugate() * inverse[k, j]
                total += y[i, e] * weight
            g[i, j] = total
    for j in range(n_u):
        total_weight = 0.0
        for e in range(n_e):
            weight = 0.0j
            for k in range(n_u):
                weight += w[k, e].conjugate() * inverse[k, j]
            total_weight += weight.real**2 + weight.imag**2
        shape[j] = total_weight
    return True


@njit(cache=True, nogil=True, parallel=True)
def solve_lines(
    u: ComplexArray, y: ComplexArray, w: ComplexArray, lines: NDArray[np.intp], block: int
) -> tuple[ComplexArray, Array, Array, Array, Array, Array, NDArray[np.bool_]]:
    """Return response, gain and sums of squares at each of `lines`.

    Shapes: `u`, `w` (n_f, n_u, experiments, periods), `y` (n_f, n_y, …). Returns G (n_l, n_y, n_u), the diagonal of S
    (n_l, n_u), the sum of squares over periods about their mean, of the misfit of the averages and of the averaged
    output (n_l, n_y), that of the responses of single blocks of `block` experiments about G (n_l, n_y, n_u; zero with
    block 0), and a flag (n_l,) that is False where the inputs cannot be separated.
    """
    n_l, n_u, n_e, n_p = lines.size, u.shape[1], u.shape[2], u.shape[3]
    n_y = y.shape[1]
    g = np.zeros((n_l, n_y, n_u), dtype=np.complex128)
    shape = np.zeros((n_l, n_u))
    scatter, misfit, power = np.zeros((n_l, n_y)), np.zeros((n_l, n_y)), np.zeros((n_l, n_y))
    good, spread = np.zeros(n_l, dtype=np.bool_), np.zeros((n_l, n_y, n_u))
    chunk = 256
    for start in prange((n_l + chunk - 1) // chunk):
        um, wm = np.empty((n_u, n_e), dtype=np.complex128), np.empty((n_u, n_e), dtype=np.complex128)
        ym = np.empty((n_y, n_e), dtype=np.complex128)
        work, inverse = np.empty((n_u, n_u), dtype=np.complex128), np.empty((n_u, n_u), dtype=np.complex128)
        part, unused = np.empty((n_y, n_u), dtype=np.complex128), np.empty(n_u)
        for k in range(start * chunk, min((start + 1) * chunk, n_l)):
            line = lines[k]
            _means(u[line], um)
            _means(w[line], wm)
            _means(y[line], ym)
            good[k] = _solve_line(um, ym, wm, g[k], shape[k], work, inverse)
            if block > 0:
                for first in range(0, n_e, block):
                    stop = first + block
                    good[k] &= _solve_line(
                        um[:, first:stop], ym[:, first:stop], wm[:, first:stop], part, unused, work, inverse
                    )
                    for i in range(n_y):
                        for j in range(n_u):
                            away = part[i, j] - g[k, i, j]
                            spread[k, i, j] += away.real**2 + away.imag**2
            for i in range(n_y):
                for e in range(n_e):
                    mean = ym[i, e]
                    power[k, i] += mean.real**2 + mean.imag**2
                    for j in range(n_u):
                        mean -= g[k, i, j] * um[j, e]
                    misfit[k, i] += mean.real**2 + mean.imag**2
                    for p in range(n_p):
                        value = y[line, i, e, p] - mean
                        for j in range(n_u):
                            value -= g[k, i, j] * u[line, j, e, p]
                        scatter[k, i] += value.real**2 + value.imag**2
    return g, shape, scatter, misfit, power, spread, good
