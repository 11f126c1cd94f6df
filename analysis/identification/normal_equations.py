"""Levenberg-Marquardt on accumulated normal equations, for problems whose Jacobian is too tall to be stored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]


TRIED = 30
"""Steps after which a start that still leaves far too much is given up: most that lead to a minimum need ten."""


@dataclass(frozen=True)
class Normal:
    """Sum of squared residuals, with J'r (p,) and J'J (p, p) where the residual is model minus data."""

    cost: float
    gradient: Array
    hessian: Array


@dataclass(frozen=True)
class Minimum:
    """Parameters (p,) at the minimum, the normal equations there, iterations taken and whether it converged."""

    parameters: Array
    normal: Normal
    iterations: int
    converged: bool


def minimise(
    assemble: Callable[[Array], Normal],
    cost: Callable[[Array], float],
    start: Array,
    iterations: int = 100,
    tolerance: float = 1e-8,
    limit: Array | float = np.inf,
    hopeless: float = np.inf,
) -> Minimum:
    """Return the minimum of a sum of squares, from `start` (p,).

    `assemble` gives the normal equations and `cost` the sum of squares alone. Damping follows Nielsen (1999); steps
    are scaled by the diagonal of J'J, so units of the parameters do not matter, and directions that the data do not
    see (the free scaling of a mode between input and output) are left where they are. No parameter moves by more than
    its `limit` (p,) in one step. Converged when a step predicts and brings a relative decrease below `tolerance`; given
    up when `TRIED` steps leave more than is `hopeless`.
    """
    x, damping, growth = start.copy(), 1e-3, 2.0
    normal = assemble(x)
    for count in range(iterations):
        if count == TRIED and normal.cost > hopeless:
            return Minimum(x, normal, count, False)
        step, predicted = _step(normal, damping, limit)
        aim = x + step
        trial = cost(aim)
        actual = normal.cost - trial
        if np.isfinite(trial) and actual >= 0.0 and predicted > 0.0:
            small = max(predicted, actual) <= tolerance * max(normal.cost, np.finfo(float).tiny)
            x = aim
            normal = assemble(x)
            if small:
                return Minimum(x, normal, count + 1, True)
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * actual / predicted - 1.0) ** 3)
            damping, growth = max(damping, 1e-12), 2.0
            continue
        # a step too small to change the cost beyond rounding is the end, not a failure
        if predicted <= 1e-13 * normal.cost or damping > 1e12:
            return Minimum(x, normal, count + 1, True)
        damping, growth = damping * growth, growth * 2.0
    return Minimum(x, normal, iterations, False)


def _step(normal: Normal, damping: float, limit: Array | float) -> tuple[Array, float]:
    """Return the damped step and the decrease that the quadratic model predicts for it."""
    scale = column_scale(normal.hessian)
    scaled = normal.hessian / (scale[:, None] * scale)
    gradient = normal.gradient / scale
    boost = damping
    while True:
        damped = scaled.copy()
        damped.flat[:: scale.size + 1] += boost
        # without the checks and copies of scipy's cho_factor, which take longer than the factor of a small matrix
        factor, failed = scipy.linalg.lapack.dpotrf(damped, clean=0)
        if not failed:
            break
        boost = max(10.0 * boost, 1e-14)
    step = -scipy.linalg.lapack.dpotrs(factor, gradient)[0]
    # each on its own: one parameter without influence that runs away must not hold up the others
    most = limit * scale
    step = np.minimum(np.maximum(step, -most), most)
    predicted = -float(step @ (2.0 * gradient + scaled @ step))
    return step / scale, predicted


def column_scale(hessian: Array) -> Array:
    """Return the square root of the diagonal of J'J (p,), one where a parameter has no effect."""
    diagonal = np.sqrt(hessian.diagonal())
    # no unit of measurement is a factor of 1e100: what is less than that has underflowed
    return np.where(diagonal > 1e-100 * np.max(diagonal, initial=0.0), diagonal, 1.0)


def covariance(normal: Normal) -> Array:
    """Return the parameter covariance (p, p) for unit residual variance: the pseudo-inverse of J'J.

    Directions without information (eigenvalue below 1e-12 of the largest, after scaling to a unit diagonal) get no
    variance: they are choices of coordinates, and no quantity that the data determine depends on them.
    """
    scale = column_scale(normal.hessian)
    units = scale[:, None] * scale
    scaled = normal.hessian / units
    inverse = _certain_inverse(scaled)
    if inverse is None:
        values, vectors = np.linalg.eigh(scaled)
        keep = values > 1e-12 * values[-1]
        inverse = (vectors[:, keep] / values[keep]) @ vectors[:, keep].T
    return inverse / units


def _certain_inverse(matrix: Array) -> Array | None:
    """Return the inverse where no eigenvalue can be below 1e-10 of the largest, by the norms of both, or None."""
    factor, failed = scipy.linalg.lapack.dpotrf(matrix)
    if failed:
        return None
    upper = scipy.linalg.lapack.dpotri(factor)[0]
    inverse = upper + np.triu(upper, 1).T
    condition = np.abs(inverse).sum(axis=0).max() * np.abs(matrix).sum(axis=0).max()
    return inverse if condition < 1e10 else None
