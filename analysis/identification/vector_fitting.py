"""Relaxed vector fitting with poles common to all entries: a start for fits of frequency responses.

Gustavsen & Semlyen (1999), relaxed normalisation by Gustavsen (2006), and the column compression of Deschrijver et al.
(2008). It works on partial fractions in lambda = s for a continuous measurement, lambda = z behind a zero-order hold.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from sim_backend.jit import njit
from sim_backend.linear import Array

ComplexArray = NDArray[np.complex128]


_SETTLED = 1e-3
"""Relative change of the poles below which they are near enough: what refines them converges from there."""


@dataclass(frozen=True)
class PoleResidues:
    """Sum over k of residues[k] / (s - poles[k]) + d: `poles` (n,) with their conjugates, `residues` (n, n_y, n_u)."""

    poles: ComplexArray
    residues: ComplexArray
    d: Array


def vector_fit(
    frequency_hz: Array,
    response: ComplexArray,
    n_poles: int,
    weight: Array,
    hold_rate_hz: float | None = None,
    feedthrough: bool = True,
    iterations: int = 15,
) -> PoleResidues:
    """Return common poles and full residues that fit `response` (n_f, n_y, n_u), in continuous time.

    `weight` (n_f, n_y, n_u) multiplies the error. `n_poles` is even. Poles that leave the stable region are reflected.
    """
    scale = float(hold_rate_hz) if hold_rate_hz is not None else 2.0 * np.pi * float(frequency_hz[-1])
    s = 2j * np.pi * frequency_hz / scale
    sampled = hold_rate_hz is not None
    point = np.asarray(np.exp(s) if sampled else s, dtype=np.complex128)
    data = response.reshape(frequency_hz.size, -1)
    weights = weight.reshape(data.shape)
    poles = _starting_poles(np.abs(s), n_poles)
    if sampled:
        poles = np.exp(poles)
    size = float(np.linalg.norm(weights * np.abs(data)))
    rest = 1.0 if sampled else 0.0  # where a pole of frequency zero stands
    for _ in range(iterations):
        moved = _relocate(point, data, weights, poles, feedthrough, size)
        moved = _stable(moved, sampled)
        after, before = np.sort_complex(moved), np.sort_complex(poles)
        change = np.max(np.abs(after - before) / np.abs(after - rest))
        poles = moved
        if change < _SETTLED:
            break
    poles = _pairable(poles) if sampled else poles
    residues, d = _residues(point, data, weights, poles, feedthrough)
    if sampled:
        held = np.log(poles)
        # the zero-order hold turns 1 / (s - p) into ((e^pT - 1) / p) / (z - e^pT)
        residues = residues * (held / np.expm1(held))[:, None]
        poles = held
    shape = (n_poles, response.shape[1], response.shape[2])
    return PoleResidues(poles * scale, (residues * scale).reshape(shape), d.reshape(shape[1:]))


def _starting_poles(s_abs: Array, n_poles: int) -> ComplexArray:
    """Return lightly damped pairs spread evenly over the logarithm of the band, with linear ones among them.

    Resonances sit anywhere, and the lines of a multisine crowd at the top of the band while its decades do not: the
    pairs split the band evenly by the mean of its share of the lines and its share of the decades.
    """
    pairs = n_poles // 2
    low = max(s_abs[0], s_abs[-1] * 1e-4) if s_abs[0] > 0.0 else s_abs[-1] * 1e-3
    decades = np.log(np.maximum(s_abs, low) / low) / np.log(s_abs[-1] / low)
    share = 0.5 * (decades + np.linspace(0.0, 1.0, s_abs.size))
    centre = np.maximum(np.interp(np.arange(1, pairs + 1) / (pairs + 1), share, s_abs), low)
    upper = centre * (-0.01 + 1j)
    return np.stack([upper, upper.conj()], axis=1).ravel()


@njit
def _basis(point: ComplexArray, poles: ComplexArray) -> ComplexArray:
    """Return the partial fractions (n, n_f) whose coefficients are real: sums and differences for complex pairs."""
    basis = np.empty((poles.size, point.size), dtype=np.complex128)
    for k in range(poles.size):
        for f in range(point.size):
            basis[k, f] = 1.0 / (point[f] - poles[k])
        if poles[k].imag < 0.0:
            for f in range(point.size):
                first, second = basis[k - 1, f], basis[k, f]
                basis[k - 1, f], basis[k, f] = first + second, 1j * (first - second)
    return basis


@njit
def _joint(basis: ComplexArray, data: ComplexArray, weights: Array, feedthrough: bool) -> Array:
    """Return the weighted columns of the model, then of minus the data times sigma, real above imaginary parts.

    Shape (k, 2 n_f), a column in a row: the partial fractions, and one for the constant where there is one.
    """
    n, lines = basis.shape
    width = n + 1 if feedthrough else n
    out = np.empty((width + n + 1, 2 * lines))
    for f in range(lines):
        w, away = weights[f], -weights[f] * data[f]
        for k in range(n):
            value, turned = w * basis[k, f], away * basis[k, f]
            out[k, f], out[k, lines + f] = value.real, value.imag
            out[width + k, f], out[width + k, lines + f] = turned.real, turned.imag
        if feedthrough:
            out[n, f], out[n, lines + f] = w, 0.0
        out[width + n, f], out[width + n, lines + f] = away.real, away.imag
    return out


def _real(matrix: ComplexArray) -> Array:
    return np.concatenate([matrix.real, matrix.imag])


def _relocate(
    point: ComplexArray, data: ComplexArray, weights: Array, poles: ComplexArray, feedthrough: bool, size: float
) -> ComplexArray:
    """Return the zeros of the weighting function sigma(lambda), the next poles; `size` is that of the weighted data."""
    basis = _basis(point, poles)
    n = poles.size
    width, blocks = n + 1 if feedthrough else n, []
    for e in range(data.shape[1]):
        columns = _joint(basis, data[:, e], weights[:, e], feedthrough)
        factor = scipy.linalg.lapack.dgeqrf(columns.T, overwrite_a=True)[0]
        blocks.append(np.triu(factor[width : width + n + 1, width:]))
    stacked = np.concatenate(blocks)
    # relaxed normalisation: the real part of sigma sums to the number of lines
    sums = np.append(basis.real.sum(axis=1), point.size)
    anchor = sums * size / point.size
    system = np.concatenate([stacked, anchor[None]])
    target = np.zeros(system.shape[0])
    target[-1] = anchor[-1]
    column = np.linalg.norm(system, axis=0)
    column = np.where(column > 0.0, column, 1.0)
    solution = np.linalg.lstsq(system / column, target, rcond=None)[0] / column
    constant = solution[-1] if abs(solution[-1]) > 1e-8 else np.copysign(1e-8, solution[-1])
    block, drive = np.zeros((n, n)), np.ones(n)
    for k in np.flatnonzero(poles.imag == 0.0):
        block[k, k] = poles[k].real
    for k in np.flatnonzero(poles.imag > 0.0):
        p = poles[k]
        block[k : k + 2, k : k + 2] = [[p.real, p.imag], [-p.imag, p.real]]
        drive[k], drive[k + 1] = 2.0, 0.0
    return _ordered(np.linalg.eigvals(block - np.outer(drive, solution[:-1]) / constant))


def _ordered(poles: ComplexArray) -> ComplexArray:
    """Return the poles with each conjugate right behind its upper partner, real ones last."""
    upper = poles[poles.imag > 0.0]
    pairs = np.stack([upper, upper.conj()], axis=1).ravel()
    return np.concatenate([pairs, poles[poles.imag == 0.0]])


def _stable(poles: ComplexArray, sampled: bool) -> ComplexArray:
    """Return the poles with unstable ones reflected and those on the border moved just inside."""
    if sampled:
        size = np.abs(poles)
        poles = np.where(size > 1.0, 1.0 / poles.conj(), poles)
        return np.where(np.abs(poles) > 1.0 - 1e-9, poles * (1.0 - 1e-9), poles)
    real = np.minimum(-np.abs(poles.real), -1e-9 * np.abs(poles))
    return real + 1j * poles.imag


def _pairable(poles: ComplexArray) -> ComplexArray:
    """Return sampled poles that have a continuous partner: negative or zero real ones are moved.

    A single negative real z has no real continuous equivalent. It carries almost nothing below the Nyquist frequency,
    so it is mirrored to a fast real pole, from where the refinement moves it.
    """
    fast = np.clip(np.abs(poles.real), 1e-3, None)
    return np.where((poles.imag == 0.0) & (poles.real < 1e-3), fast, poles)


def _residues(
    point: ComplexArray, data: ComplexArray, weights: Array, poles: ComplexArray, feedthrough: bool
) -> tuple[ComplexArray, Array]:
    """Return the residues (n, entries) and feedthrough (entries,) by weighted least squares for given poles."""
    basis = _basis(point, poles).T
    if feedthrough:
        basis = np.concatenate([basis, np.ones((point.size, 1))], axis=1)
    coefficient = np.empty((basis.shape[1], data.shape[1]))
    for e in range(data.shape[1]):
        w = weights[:, e, None]
        system = _real(w * basis)
        column = np.linalg.norm(system, axis=0)
        target = _real(w * data[:, e, None])[:, 0]
        coefficient[:, e] = np.linalg.lstsq(system / column, target, rcond=None)[0] / column
    residues = coefficient[: poles.size].astype(complex)
    for k in np.flatnonzero(poles.imag > 0.0):
        first, second = residues[k].copy(), residues[k + 1].copy()
        residues[k], residues[k + 1] = first + 1j * second, first - 1j * second
    return residues, coefficient[-1] if feedthrough else np.zeros(data.shape[1])
