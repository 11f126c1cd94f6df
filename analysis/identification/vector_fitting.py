"""Relaxed vector fitting with poles common to all entries: a start for fits of frequency responses.

Gustavsen & Semlyen (1999), relaxed normalisation by Gustavsen (2006), and the column compression of Deschrijver et al.
(2008). It works on partial fractions in lambda = s for a continuous measurement, lambda = z behind a zero-order hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.identification.pole_equations import companion, reduced, scaled_system, settled
from sim_backend.linear import Array

ComplexArray = NDArray[np.complex128]


_ROUNDING = float(np.finfo(float).eps)
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
    *,
    stable: bool = True,
) -> PoleResidues:
    """Return common poles and full residues that fit `response` (n_f, n_y, n_u), in continuous time.

    `weight` (n_f, n_y, n_u) multiplies the error. `n_poles` is even. Poles that leave the stable region are reflected,
    unless `stable` is False.
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
    for _ in range(iterations):
        real, imag = _relocate(point, data, weights, poles, feedthrough, size)
        if not stable:
            poles = _paired(real, imag)
            continue
        poles, change = settled(real, imag, poles, sampled)
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


def _relocate(
    point: ComplexArray, data: ComplexArray, weights: Array, poles: ComplexArray, feedthrough: bool, size: float
) -> tuple[Array, Array]:
    """Return the zeros of the weighting function sigma(lambda), the next poles, as real and imaginary parts.

    `size` is that of the weighted data.
    """
    system, target, column = scaled_system(point, data, weights, poles, feedthrough, size)
    matrix, finite = companion(poles, _least_squares(system, target, system.shape[0]) / column)
    if not finite:
        raise np.linalg.LinAlgError("the poles of a vector fit are not finite")
    real, imag, _, _, _ = scipy.linalg.lapack.dgeev(matrix, compute_vl=0, compute_vr=0)
    return real, imag


def _least_squares(system: Array, target: Array, rows: int) -> Array:
    """Return the shortest of the best solutions; what is below the rounding of so many `rows` counts as nothing."""
    lwork, iwork = _workspace(*system.shape)
    found, _, _, failed = scipy.linalg.lapack.dgelsd(system, target, lwork, iwork, _ROUNDING * rows)
    if failed:
        raise np.linalg.LinAlgError("the least squares of a vector fit did not converge")
    return found[: system.shape[1]]


@cache
def _workspace(rows: int, columns: int) -> tuple[int, int]:
    """Return how many numbers, real and whole, LAPACK needs for least squares of this size."""
    lwork, iwork, _ = scipy.linalg.lapack.dgelsd_lwork(rows, columns, 1)
    return int(lwork), int(iwork)


def _paired(real: Array, imag: Array) -> ComplexArray:
    """Return eigenvalues where they are, each conjugate right behind its upper partner, real ones last."""
    upper = (real + 1j * imag)[imag > 0.0]
    return np.concatenate([np.stack([upper, upper.conj()], axis=1).ravel(), real[imag == 0.0].astype(complex)])


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
    triangle, _ = reduced(point, data, weights, poles, feedthrough, False)
    width = triangle.shape[1] - 1
    coefficient = np.empty((width, data.shape[1]))
    for e, part in enumerate(triangle):
        column = np.linalg.norm(part[:, :width], axis=0)
        coefficient[:, e] = _least_squares(part[:, :width] / column, -part[:, width], 2 * point.size) / column
    residues = coefficient[: poles.size].astype(complex)
    upper = np.flatnonzero(poles.imag > 0.0)
    first, second = residues[upper], residues[upper + 1]
    residues[upper], residues[upper + 1] = first + 1j * second, first - 1j * second
    return residues, coefficient[-1] if feedthrough else np.zeros(data.shape[1])
