"""The normal equations of a fit to a frequency response, compiled: a few lines at a time, the Jacobian never stored.

All working data stay in the processor's nearest cache, real and imaginary parts apart, so that its vector
instructions can be used.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.identification.block_basis import continuous
from analysis.identification.cache_lines import in_cache_lines
from sim_backend.jit import njit
from sim_backend.linear import Array

ComplexArray = NDArray[np.complex128]

_LINES = 64
"""Lines that are taken together: the Jacobian of one entry and four blocks takes 28 kB of them."""
_SUMMED = {"reassoc", "contract"}
"""Sums may be taken in any order, several terms at a time."""


@njit(error_model="numpy")
def summed(
    vector: Array,
    sizes: tuple[int, int, int],
    held: tuple[Array, Array, Array, Array] | None,
    point: ComplexArray,
    delay: tuple[ComplexArray, ComplexArray],
    weight: Array,
    response: ComplexArray,
    magnitude_only: bool,
    places: NDArray[np.intp],
) -> tuple[float, Array, Array]:
    """Return the squared residual, J'r (p,) and J'J (p, p) at the parameters `vector` (p,) of a `Layout`.

    `sizes` are its numbers of blocks, inputs and outputs. `held` are the arrays of `BlockMatrices` behind a hold, None
    for a continuous measurement, resolved at lambda = `point` (n_f,); `delay` (n_f, n_u) are the delay's factor and its
    derivative. The 6 m + 2 derivatives of an entry are those to ln(omega), ln(sigma), b, b_direct, c, c_rate of every
    block, to D and to the delay; they are at the indices `places` (n_y, n_u, 6 m + 2) in the vector.
    """
    model, size = _split(vector, sizes), vector.size
    blocks = continuous(model[0], model[1]) if held is None else held
    n_y, n_u, m = model[4].shape[0], model[2].shape[1], model[0].size
    k = 6 * m + 3
    out = np.zeros((n_y, n_u, k, k))
    # a pair of rows is multiplied with a pair at a time; an odd one has a row of zeros for its partner
    rows = in_cache_lines(k + k % 2, 2 * _LINES)
    state, factor = in_cache_lines(m, 16 * _LINES), in_cache_lines(1, 6 * _LINES)[0]
    for first in range(0, point.size, _LINES):
        lines = slice(first, min(first + _LINES, point.size))
        if first + _LINES > point.size:
            _clear(state, 0)
            _clear(rows, 0)
        _resolve(blocks[0], blocks[1], blocks[2], blocks[3], point[lines], state)
        for y in range(n_y):
            for u in range(n_u):
                of = _entry(model, y, u)
                seen = weight[lines, y, u], response[lines, y, u], delay[0][lines, u], delay[1][lines, u]
                _residual(of, model[6][y, u], state, seen, magnitude_only, factor, rows[k - 1])
                _derivatives(of, state, factor, rows)
                if magnitude_only:
                    _clear(rows, _LINES)
                _add_products(rows, out[y, u])
    cost, gradient, hessian = 0.0, np.zeros(size), np.zeros((size, size))
    for y in range(n_y):
        for u in range(n_u):
            cost += out[y, u, k - 1, k - 1]
            for i in range(k - 1):
                gradient[places[y, u, i]] += out[y, u, i, k - 1]
                for j in range(k - 1):
                    hessian[places[y, u, i], places[y, u, j]] += out[y, u, i, j]
    return cost, gradient, hessian


@njit
def _clear(rows: Array, first: int) -> None:
    """Set all columns from `first` on to zero, number by number (docs/decisions/0026)."""
    for i in range(rows.shape[0]):
        for f in range(first, rows.shape[1]):
            rows[i, f] = 0.0


@njit
def _split(vector: Array, sizes: tuple[int, int, int]) -> tuple[Array, Array, Array, Array, Array, Array, Array]:
    """Return omega, sigma, b, b_direct, c, c_rate and d of a parameter vector."""
    m, n_u, n_y = sizes
    start, into, out = 2 * m, m * n_u, m * n_y
    c = start + 2 * into
    return (
        np.exp(vector[:m]),
        np.exp(vector[m:start]),
        vector[start : start + into].reshape(m, n_u),
        vector[start + into : c].reshape(m, n_u),
        vector[c : c + out].reshape(n_y, m),
        vector[c + out : c + 2 * out].reshape(n_y, m),
        vector[c + 2 * out : c + 2 * out + n_y * n_u].reshape(n_y, n_u),
    )


@njit(error_model="numpy")
def _resolve(a: Array, b: Array, da: Array, db: Array, point: ComplexArray, state: Array) -> None:
    """Fill `state` (m, 16 _LINES): q and v, their slopes to ln(omega), those to ln(sigma), lambda, 1 / determinant.

    x = (lambda I - A)^-1 b and (lambda I - A)^-1 (dA x + db), by Cramer's rule for each block. Of each of the eight
    numbers there are all real parts, then all imaginary ones: at fixed distances in one row, so that the compiler sees
    that they do not overlap.
    """
    n = _LINES
    for i in range(a.shape[0]):
        a00, a01, a10, a11 = a[i, 0, 0], a[i, 0, 1], a[i, 1, 0], a[i, 1, 1]
        b0, b1, out = b[i, 0], b[i, 1], state[i]
        for f in range(point.size):
            out[12 * n + f], out[13 * n + f] = point[f].real, point[f].imag
        for f in range(point.size):
            top, bottom, y = out[12 * n + f] - a00, out[12 * n + f] - a11, out[13 * n + f]
            re, im = top * bottom - y * y - a01 * a10, y * (top + bottom)
            shrink = 1.0 / (re * re + im * im)
            re, im = re * shrink, -im * shrink
            q, v = bottom * b0 + a01 * b1, a10 * b0 + top * b1
            out[14 * n + f], out[15 * n + f] = re, im
            out[f], out[n + f] = q * re - y * b0 * im, q * im + y * b0 * re
            out[2 * n + f], out[3 * n + f] = v * re - y * b1 * im, v * im + y * b1 * re
        for k in range(2):
            e00, e01, e10, e11 = da[k, i, 0, 0], da[k, i, 0, 1], da[k, i, 1, 0], da[k, i, 1, 1]
            e0, e1, slope = db[k, i, 0], db[k, i, 1], state[i, 4 * (1 + k) * n : 4 * (2 + k) * n]
            for f in range(point.size):
                top, bottom, y = out[12 * n + f] - a00, out[12 * n + f] - a11, out[13 * n + f]
                re, im = out[14 * n + f], out[15 * n + f]
                p_re, p_im = e00 * out[f] + e01 * out[2 * n + f] + e0, e00 * out[n + f] + e01 * out[3 * n + f]
                r_re, r_im = e10 * out[f] + e11 * out[2 * n + f] + e1, e10 * out[n + f] + e11 * out[3 * n + f]
                s_re, s_im = bottom * p_re - y * p_im + a01 * r_re, bottom * p_im + y * p_re + a01 * r_im
                t_re, t_im = a10 * p_re + top * r_re - y * r_im, a10 * p_im + top * r_im + y * r_re
                slope[f], slope[n + f] = s_re * re - s_im * im, s_re * im + s_im * re
                slope[2 * n + f], slope[3 * n + f] = t_re * re - t_im * im, t_re * im + t_im * re


@njit
def _entry(model: tuple[Array, Array, Array, Array, Array, Array, Array], y: int, u: int) -> Array:
    """Return the weights (14, m) of one entry on (q, v): two for the response, then two for each derivative of a block.

    See `modal_parameters` for the equations. To ln(omega) and ln(sigma), the weights on the slopes of q and v are those
    of the response, and to these the weights here on q and v are added.
    """
    omega, sigma, b, b_direct, c, c_rate, _ = model
    of = np.zeros((14, omega.size))
    for i in range(omega.size):
        omega2, sigma2 = omega[i] ** 2, 2.0 * sigma[i]
        into, direct, out, rate = b[i, u], b_direct[i, u], c[y, i], c_rate[y, i]
        force = sigma2 * direct + into
        of[0, i], of[1, i] = out * force - omega2 * rate * direct, out * direct + rate * into
        of[2, i] = -2.0 * omega2 * rate * direct
        of[4, i] = sigma2 * out * direct
        of[6, i], of[7, i] = out, rate
        of[8, i], of[9, i] = sigma2 * out - omega2 * rate, out
        of[10, i], of[11, i] = force, direct
        of[12, i], of[13, i] = -omega2 * direct, into
    return of


@njit(error_model="numpy")
def _residual(
    of: Array,
    d: float,
    state: Array,
    seen: tuple[Array, ComplexArray, ComplexArray, ComplexArray],
    magnitude_only: bool,
    factor: Array,
    row: Array,
) -> None:
    """Fill `row` with the weighted residual of one entry, and `factor` (6 _LINES) with three numbers, Re and Im each.

    They are what a derivative of the response without delay is multiplied by, the derivative to the delay, and the
    response without delay.
    """
    weight, data, into, slope = seen
    n = _LINES
    for f in range(n):
        factor[4 * n + f], factor[5 * n + f] = d, 0.0
    for i in range(of.shape[1]):
        n0, n1, own = of[0, i], of[1, i], state[i]
        for f in range(n):
            factor[4 * n + f] += n0 * own[f] + n1 * own[2 * n + f]
            factor[5 * n + f] += n0 * own[n + f] + n1 * own[3 * n + f]
    for f in range(weight.size):
        bare, scale = complex(factor[4 * n + f], factor[5 * n + f]), complex(weight[f], 0.0)
        value = bare * into[f]
        if magnitude_only:
            size = abs(value)
            row[f] = weight[f] * (size - abs(data[f]))
            scale = scale * value.conjugate() / (size if size > 0.0 else 1.0)
        else:
            rest = weight[f] * (value - data[f])
            row[f], row[n + f] = rest.real, rest.imag
        whole, late = scale * into[f], scale * bare * slope[f]
        factor[f], factor[n + f], factor[2 * n + f], factor[3 * n + f] = whole.real, whole.imag, late.real, late.imag
    for f in range(weight.size, n):
        factor[f] = factor[n + f] = factor[2 * n + f] = factor[3 * n + f] = 0.0


@njit
def _derivatives(of: Array, state: Array, factor: Array, rows: Array) -> None:
    """Fill `rows` with the weighted derivatives of one entry, a row each: real parts, then imaginary ones."""
    n, m = _LINES, of.shape[1]
    for i in range(m):
        own, n0, n1 = state[i], of[0, i], of[1, i]
        for j in range(6):
            row, on_q, on_v = rows[j * m + i], of[2 + 2 * j, i], of[3 + 2 * j, i]
            if j < 2:
                slope = state[i, 4 * (1 + j) * n : 4 * (2 + j) * n]
                for f in range(n):
                    re = n0 * slope[f] + n1 * slope[2 * n + f] + on_q * own[f]
                    im = n0 * slope[n + f] + n1 * slope[3 * n + f] + on_q * own[n + f]
                    row[f], row[n + f] = re * factor[f] - im * factor[n + f], re * factor[n + f] + im * factor[f]
            else:
                for f in range(n):
                    re, im = on_q * own[f] + on_v * own[2 * n + f], on_q * own[n + f] + on_v * own[3 * n + f]
                    row[f], row[n + f] = re * factor[f] - im * factor[n + f], re * factor[n + f] + im * factor[f]
    for f in range(2 * n):
        rows[6 * m, f], rows[6 * m + 1, f] = factor[f], factor[2 * n + f]


@njit(fastmath=_SUMMED)
def _add_products(rows: Array, out: Array) -> None:
    """Add the products of all rows with one another to `out` (k, k)."""
    k = out.shape[0]
    for i in range(0, k, 2):
        first, second = rows[i], rows[i + 1]
        for j in range(0, i + 2, 2):
            third, fourth = rows[j], rows[j + 1]
            s00 = s01 = s10 = s11 = 0.0
            for f in range(rows.shape[1]):
                s00 += first[f] * third[f]
                s01 += first[f] * fourth[f]
                s10 += second[f] * third[f]
                s11 += second[f] * fourth[f]
            _place(out, i, j, s00)
            if i + 1 < k:
                _place(out, i + 1, j, s10)
            if j + 1 < i:
                _place(out, i, j + 1, s01)
            if i + 1 < k and j + 1 < k:
                _place(out, i + 1, j + 1, s11)


@njit(inline="always")
def _place(out: Array, i: int, j: int, value: float) -> None:
    out[i, j] += value
    if i != j:
        out[j, i] += value
