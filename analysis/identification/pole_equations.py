"""The least squares of vector fitting, compiled: tall systems of partial fractions, reduced to a triangle line by line.

A tall system is never stored. A few lines at a time are reduced into the triangle of those before them by Householder's
reflections, so that all working data stay in the processor's nearest cache.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from analysis.identification.cache_lines import in_cache_lines
from sim_backend.jit import njit
from sim_backend.linear import Array

ComplexArray = NDArray[np.complex128]

_LINES = 64
"""Lines that are taken together: their columns of an eighth-order fit take 18 kB."""
_SUMMED = {"reassoc", "contract"}
"""Sums may be taken in any order, several terms at a time."""


@njit(error_model="numpy", fastmath=_SUMMED)
def reduced(
    point: ComplexArray, data: ComplexArray, weights: Array, poles: ComplexArray, feedthrough: bool, moving: bool
) -> tuple[Array, Array]:
    """Return the triangles (entries, k, k) of the weighted systems, and the sums over lines (n + 1,) of its real parts.

    Columns are the `n` partial fractions of the model, one for the constant where there is one, and minus the data
    times sigma: its partial fractions if poles are `moving`, and its constant. Those of a complex pair are the sum and
    the difference of both, so that all coefficients are real. `point` (n_f,), `data` and `weights` (n_f, entries).
    """
    n, entries = poles.size, data.shape[1]
    width = n + 1 if feedthrough else n
    k = width + n + 1 if moving else width + 1
    triangle, sums = np.zeros((entries, k, k)), np.zeros(n + 1)
    real, imag, rows = in_cache_lines(n, _LINES), in_cache_lines(n, _LINES), in_cache_lines(k + 1, 2 * _LINES)
    for first in range(0, point.size, _LINES):
        lines = min(_LINES, point.size - first)
        if lines < _LINES:
            for i in range(k + 1):
                for f in range(2 * _LINES):
                    rows[i, f] = 0.0
        _fractions(point[first : first + lines], poles, real, imag)
        for i in range(n):
            for f in range(lines):
                sums[i] += real[i, f]
        for e in range(entries):
            for f in range(lines):
                w = weights[first + f, e]
                away = -w * data[first + f, e]
                if feedthrough:
                    rows[n, f], rows[n, _LINES + f] = w, 0.0
                rows[k - 1, f], rows[k - 1, _LINES + f] = away.real, away.imag
            last = rows[k - 1]
            for i in range(n):
                for f in range(lines):
                    w = weights[first + f, e]
                    rows[i, f], rows[i, _LINES + f] = w * real[i, f], w * imag[i, f]
                if moving:
                    for f in range(lines):
                        a, b = last[f], last[_LINES + f]
                        rows[width + i, f] = a * real[i, f] - b * imag[i, f]
                        rows[width + i, _LINES + f] = a * imag[i, f] + b * real[i, f]
            _absorb(triangle[e], rows)
    sums[n] = point.size
    return triangle, sums


@njit(error_model="numpy")
def _fractions(point: ComplexArray, poles: ComplexArray, real: Array, imag: Array) -> None:
    """Fill (n, lines) with 1 / (point - pole), for a pair by p1 + p2 and j (p1 - p2)."""
    for k in range(poles.size):
        p = poles[k]
        if p.imag < 0.0:
            continue
        for f in range(point.size):
            x, y = point[f].real - p.real, point[f].imag - p.imag
            shrink = 1.0 / (x * x + y * y)
            real[k, f], imag[k, f] = x * shrink, -y * shrink
        if p.imag > 0.0:
            for f in range(point.size):
                x, y = point[f].real - p.real, point[f].imag + p.imag
                shrink = 1.0 / (x * x + y * y)
                re, im = x * shrink, -y * shrink
                real[k + 1, f], imag[k + 1, f] = im - imag[k, f], real[k, f] - re
                real[k, f], imag[k, f] = real[k, f] + re, imag[k, f] + im


@njit(error_model="numpy", fastmath=_SUMMED)
def _absorb(triangle: Array, rows: Array) -> None:
    """Reduce more equations, a column in a row of `rows`, into the upper `triangle` (k, k); the equations are lost.

    `rows` (k + 1, m) has a row of zeros for the partner of an odd column: two are reduced at a time.
    """
    k, m = triangle.shape[0], rows.shape[1]
    for j in range(k):
        own, corner = rows[j], triangle[j, j]
        square = 0.0
        for f in range(m):
            square += own[f] * own[f]
        if square == 0.0:
            continue
        size = math.copysign(math.sqrt(corner * corner + square), -corner)
        head = corner - size
        scale = 2.0 / (head * head + square)
        triangle[j, j] = size
        for i in range(j + 1, k, 2):
            first, second = rows[i], rows[i + 1]
            one = two = 0.0
            for f in range(m):
                one += own[f] * first[f]
                two += own[f] * second[f]
            one = scale * (one + head * triangle[j, i])
            triangle[j, i] -= one * head
            if i + 1 < k:
                two = scale * (two + head * triangle[j, i + 1])
                triangle[j, i + 1] -= two * head
            for f in range(m):
                first[f] -= one * own[f]
                second[f] -= two * own[f]


def scaled_system(
    point: ComplexArray, data: ComplexArray, weights: Array, poles: ComplexArray, feedthrough: bool, size: float
) -> tuple[Array, Array, Array]:
    """Return the equations for sigma with columns of length one, their right-hand side and the columns' lengths.

    `point` is (n_f,), `data` and `weights` (n_f, entries), `poles` (n,); the system is (entries · n + 1, n). The
    relaxed normalisation is the last row: the real part of sigma sums to the number of lines. `size` is that of the
    weighted data.
    """
    # called from here and not from compiled code, in which `reduced` would be compiled a second time
    triangle, sums = reduced(point, data, weights, poles, feedthrough, True)
    return _scaled(triangle, sums, size)


@njit
def _scaled(triangle: Array, sums: Array, size: float) -> tuple[Array, Array, Array]:
    """Return what `scaled_system` returns, of the triangles and sums of its entries."""
    entries, k, n = triangle.shape[0], triangle.shape[1], sums.size
    system, target, column = np.zeros((entries * n + 1, n)), np.zeros(entries * n + 1), np.zeros(n)
    for i in range(n):
        for e in range(entries):
            for j in range(n):
                system[e * n + j, i] = triangle[e, k - n + j, k - n + i]
        system[entries * n, i] = sums[i] * (size / sums[n - 1])
    target[entries * n] = system[entries * n, n - 1]
    for i in range(n):
        square = 0.0
        for j in range(entries * n + 1):
            square += system[j, i] ** 2
        column[i] = math.sqrt(square) if square > 0.0 else 1.0
        for j in range(entries * n + 1):
            system[j, i] /= column[i]
    return system, target, column


@njit
def companion(poles: ComplexArray, sigma: Array) -> tuple[Array, bool]:
    """Return the real matrix (n, n) whose eigenvalues are the zeros of sigma, and whether all its numbers are finite.

    `sigma` (n + 1,) are the coefficients.
    """
    n = poles.size
    matrix, drive = np.zeros((n, n)), np.ones(n)
    constant = sigma[n] if abs(sigma[n]) > 1e-8 else math.copysign(1e-8, sigma[n])
    for k in range(n):
        p = poles[k]
        matrix[k, k] = p.real
        if p.imag > 0.0:
            matrix[k, k + 1], matrix[k + 1, k] = p.imag, -p.imag
            drive[k], drive[k + 1] = 2.0, 0.0
    for i in range(n):
        for j in range(n):
            matrix[i, j] -= drive[i] * sigma[j] / constant
    return matrix, np.isfinite(np.sum(np.abs(matrix)))


@njit
def settled(real: Array, imag: Array, before: ComplexArray, sampled: bool) -> tuple[ComplexArray, float]:
    """Return eigenvalues (n,) as stable poles, each conjugate behind its upper partner, and their relative change.

    Unstable ones are reflected, those on the border moved just inside. Changes are relative to the distance from a
    pole of frequency zero.
    """
    poles, at = np.empty(real.size, dtype=np.complex128), 0
    for i in range(real.size):
        if imag[i] > 0.0:
            poles[at] = _inside(complex(real[i], imag[i]), sampled)
            poles[at + 1] = poles[at].conjugate()
            at += 2
    for i in range(real.size):
        if imag[i] == 0.0:
            poles[at] = _inside(complex(real[i], 0.0), sampled)
            at += 1
    rest, change = 1.0 if sampled else 0.0, 0.0
    after, old = _sorted(poles), _sorted(before)
    for i in range(real.size):
        change = max(change, abs(after[i] - old[i]) / abs(after[i] - rest))
    return poles, change


@njit
def _inside(pole: complex, sampled: bool) -> complex:
    if not sampled:
        return complex(min(-abs(pole.real), -1e-9 * abs(pole)), pole.imag)
    if abs(pole) > 1.0:
        pole = 1.0 / pole.conjugate()
    return pole * (1.0 - 1e-9) if abs(pole) > 1.0 - 1e-9 else pole


@njit
def _sorted(poles: ComplexArray) -> ComplexArray:
    """Return the poles by their real parts, then by their imaginary ones."""
    out = poles.copy()
    for i in range(1, out.size):
        one, j = out[i], i - 1
        while j >= 0 and (out[j].real > one.real or (out[j].real == one.real and out[j].imag > one.imag)):
            out[j + 1] = out[j]
            j -= 1
        out[j + 1] = one
    return out
