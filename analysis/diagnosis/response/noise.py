"""How well each line of a table is known: told by the file, by lines measured again, or by how rough the residual is.

Misfits of a model are smooth in frequency between resonances, noise is not. So where nothing else tells it, noise is
what differs from a parabola through neighbouring lines of the measured response over the modelled one: with weights w
that no parabola passes and a sum of squares of one, the difference Σ w q of lines with the noise σ has the variance
Σ w² σ². It has a part of its own (additive) and one in proportion to the response (in magnitude and in phase apart).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.response.lines import Lines

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ROUNDED = 1e-6
"""Relative error below which no table is trusted: digits are cut off."""

PER_LINE = 1.0 / 3.0
"""Independent numbers that a line adds to the level of the noise: neighbouring differences share three of four lines,
and a median is worth a third of its numbers."""

_TAIL = 4.0
"""Degrees of freedom of the t-distribution by which single differences are weighed: misfits at resonances are rough."""

_NORMAL = 0.674490
"""Median of the absolute value of a standard normal variable."""

_LEAST_REPEATS = 10


@dataclass(frozen=True)
class Noise:
    """Standard deviations `sigma` (n, 2) of every line along its phase and across it, in units of the response.

    Their level is known from `dof` independent numbers, infinitely many where the file states it; `source` says how.
    """

    sigma: Array
    dof: float
    source: str


def noise_of(lines: Lines, modelled: ComplexArray) -> Noise:
    """Return the noise of the lines (n,) about a model's response (n,)."""
    if lines.std is not None:
        return Noise(np.repeat(lines.std[:, None], 2, axis=1), np.inf, "standard deviations of the table")
    size = np.abs(lines.response)
    if lines.scatter.shape[0] >= _LEAST_REPEATS:
        along, across, of = lines.scatter.T
        part, rest = _levels(along / of, across / of, 1.0 / of**2)
        return Noise(_sigma(lines, size, part, rest), float(np.sum(2.0 * (lines.count - 1.0))), "repeated lines")
    along, across, weights, at = _roughness(lines, modelled)
    dof = max(PER_LINE * along.size, 2.0)
    if lines.coherence is not None:
        # S. Braun, Discover Signal Processing (2008): var |H| / |H|² = (1 - γ²) / (2 γ² averages)
        coherence = np.clip(lines.coherence, 1e-6, 1.0 - 1e-6)
        relative2 = (1.0 - coherence) / (2.0 * coherence)
        expected = np.sqrt(np.sum(weights**2 * relative2[at], axis=1))
        level = float(np.median(np.abs([along, across]) / expected)) / _NORMAL
        sigma = np.maximum(level * np.sqrt(relative2), ROUNDED) * size
        return Noise(np.repeat(sigma[:, None], 2, axis=1), dof, "coherence, its level from roughness")
    part, rest = _levels(along, across, np.sum(weights**2 / size[at] ** 2, axis=1))
    return Noise(_sigma(lines, size, part, rest), dof, "roughness of the residual")


def _sigma(lines: Lines, size: Array, part: Array, additive: float) -> Array:
    relative = np.maximum(part, ROUNDED)
    return np.asarray(np.sqrt((additive**2 + np.outer(size, relative) ** 2) / lines.count[:, None]))


def _roughness(lines: Lines, modelled: ComplexArray) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Return differences in magnitude and phase (m,), each with its weights (m, 4) on the lines `at` (m, 4)."""
    error = (lines.response - modelled) / modelled
    curves = [np.flatnonzero(lines.curve == number) for number in np.unique(lines.curve)]
    at = np.concatenate([np.lib.stride_tricks.sliding_window_view(rows, 4) for rows in curves])
    x = np.log(lines.frequency_hz[at])
    # divided differences of third order: 1 / Π (x_k - x_j)
    apart = x[:, :, None] - x[:, None, :] + np.eye(4)
    weights = 1.0 / np.prod(apart, axis=2)
    weights /= np.linalg.norm(weights, axis=1, keepdims=True)
    rough = np.sum(weights * error[at], axis=1)
    return rough.real, rough.imag, weights, at


def _levels(along: Array, across: Array, per_size2: Array) -> tuple[Array, float]:
    """Return the relative parts in magnitude and phase (2,), and the additive one, of relative differences (m,)."""
    both = np.stack([along, across])
    start = np.median(np.abs(both), axis=1) / _NORMAL + ROUNDED
    additive = float(np.median(start)) / np.sqrt(float(np.median(per_size2)))

    def variance(x: Array) -> Array:
        return np.exp(2.0 * x[:2])[:, None] + np.exp(2.0 * x[2]) * per_size2 + ROUNDED**2

    def cost(x: Array) -> float:
        v = variance(x)
        return float(np.sum(0.5 * np.log(v) + 0.5 * (_TAIL + 1.0) * np.log1p(both**2 / (_TAIL * v))))

    begin = np.log([*start, additive]) - 0.35
    found = scipy.optimize.minimize(cost, begin, method="Nelder-Mead", options={"maxiter": 400, "xatol": 1e-3}).x
    ratio = float(np.median(np.abs(both) / np.sqrt(variance(found)))) / _NORMAL
    return np.exp(found[:2]) * ratio, float(np.exp(found[2])) * ratio
