"""Position and rate of each second-order block under a unit force, as spectra with derivatives.

One formula serves both worlds: x = (lambda I - A)^-1 b, with lambda = s and the companion block for a continuous
(band-limited) measurement, or lambda = z and the exact zero-order-hold equivalent for a sampled one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backend.jit import njit
from sim_backend.linear import Array

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True)
class BlockMatrices:
    """A (m, 2, 2) and b (m, 2) of each block, with derivatives to ln(omega), ln(sigma): (2, m, 2, 2) and (2, m, 2)."""

    a: Array
    b: Array
    da: Array
    db: Array


def block_matrices(omega_rad_s: Array, sigma_1_s: Array, hold_rate_hz: float | None) -> BlockMatrices:
    """Return the matrices of blocks driven by a unit force, continuous or behind a zero-order hold.

    Frequencies and decay rates are (m,). Behind a hold, [A E; 0 A] is exponentiated, whose upper right block is the
    exact derivative in direction E (Van Loan 1978); it needs no case for rigid bodies or equal poles.
    """
    a, b, da, db = continuous(omega_rad_s, sigma_1_s)
    if hold_rate_hz is None:
        return BlockMatrices(a, b, da, db)
    m = omega_rad_s.size
    joint, slope = np.zeros((m, 3, 3)), np.zeros((2, m, 3, 3))
    joint[:, :2, :2], joint[:, :2, 2], slope[:, :, :2, :2] = a, b, da
    doubled = np.zeros((2, m, 6, 6))
    doubled[:, :, :3, :3] = doubled[:, :, 3:, 3:] = joint
    doubled[:, :, :3, 3:] = slope
    # the rate state is scaled to the size of the position state, so that one norm is fair to both
    unit = np.tile([hold_rate_hz, 1.0, 1.0], 2)
    scaled = (doubled * (unit[:, None] / unit) / hold_rate_hz).reshape(2 * m, 6, 6)
    step = exponentials(scaled).reshape(2, m, 6, 6) * (unit / unit[:, None])
    return BlockMatrices(step[0, :, :2, :2], step[0, :, :2, 2], step[:, :, :2, 3:5], step[:, :, :2, 5])


@njit
def continuous(omega_rad_s: Array, sigma_1_s: Array) -> tuple[Array, Array, Array, Array]:
    """Return the arrays of blocks of frequency and decay rate (m,) in continuous time, see `BlockMatrices`."""
    m = omega_rad_s.size
    a, b, da, db = np.zeros((m, 2, 2)), np.zeros((m, 2)), np.zeros((2, m, 2, 2)), np.zeros((2, m, 2))
    for i in range(m):
        stiffness, drag = omega_rad_s[i] ** 2, 2.0 * sigma_1_s[i]
        a[i, 0, 1], a[i, 1, 0], a[i, 1, 1], b[i, 1] = 1.0, -stiffness, -drag, 1.0
        da[0, i, 1, 0], da[1, i, 1, 1] = -2.0 * stiffness, -drag
    return a, b, da, db


@njit
def exponentials(stack: Array) -> Array:
    """Return the exponentials of a stack (k, n, n) of small matrices, by scaling, a Taylor series and squaring.

    A fit asks for a few dozen 6 × 6 matrices thousands of times, where a general routine spends its time on its own
    bookkeeping. The series stops after 18 terms: with the norm scaled below 1/2 the rest is under 1e-22.
    """
    out = np.empty_like(stack)
    n = stack.shape[1]
    for k in range(stack.shape[0]):
        norm = 0.0
        for i in range(n):
            norm = max(norm, np.sum(np.abs(stack[k, i])))
        halvings = max(0, int(np.ceil(np.log2(max(norm, 1e-300)))) + 1)
        small = stack[k] * 0.5**halvings
        total = np.eye(n)
        for term in range(18, 0, -1):
            total = _product(small, total)
            for i in range(n):
                for j in range(n):
                    total[i, j] /= term
                total[i, i] += 1.0
        for _ in range(halvings):
            total = _product(total, total)
        for i in range(n):
            for j in range(n):
                out[k, i, j] = total[i, j]  # one by one: see `analysis.linear.simulate._add_direct`
    return out


@njit
def _product(first: Array, second: Array) -> Array:
    """Return the product of two small square matrices."""
    n = first.shape[0]
    out = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            factor = first[i, k]
            if factor != 0.0:
                for j in range(n):
                    out[i, j] += factor * second[k, j]
    return out


def block_spectra(matrices: BlockMatrices, point: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return (q, v), (2, m, n_f), and derivatives to ln(omega), ln(sigma), (2, 2, m, n_f), at lambda = `point`."""
    return _resolved(matrices.a, matrices.b, matrices.da, matrices.db, point)


@njit(error_model="numpy")
def _resolved(a: Array, b: Array, da: Array, db: Array, point: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return x = (lambda I - A)^-1 b and its slopes (lambda I - A)^-1 (dA x + db), by Cramer's rule for each block."""
    m, n = a.shape[0], point.size
    state, slopes = np.empty((2, m, n), dtype=np.complex128), np.empty((2, 2, m, n), dtype=np.complex128)
    for i in range(m):
        (a00, a01), (a10, a11) = a[i]
        for f in range(n):
            top, bottom = point[f] - a00, point[f] - a11
            determinant = top * bottom - a01 * a10
            shrink = 1.0 / (determinant.real * determinant.real + determinant.imag * determinant.imag)
            inverse = complex(determinant.real * shrink, -determinant.imag * shrink)
            q, v = (bottom * b[i, 0] + a01 * b[i, 1]) * inverse, (a10 * b[i, 0] + top * b[i, 1]) * inverse
            state[0, i, f], state[1, i, f] = q, v
            for k in range(2):
                e = da[k, i]
                first, second = e[0, 0] * q + e[0, 1] * v + db[k, i, 0], e[1, 0] * q + e[1, 1] * v + db[k, i, 1]
                slopes[k, 0, i, f] = (bottom * first + a01 * second) * inverse
                slopes[k, 1, i, f] = (a10 * first + top * second) * inverse
    return state, slopes
