"""Damped Gauss-Newton descent in normal equations, stopped in units of likelihood.

General least-squares routines stop when a sum of squares changes little *relative* to itself. Here the sum of squares
is a likelihood: a change of a tenth is convergence at any size, and a change of a hundred is evidence even where it
is 1e-4 of the whole.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_CLOSE = 0.1
"""A fit has converged when a step lowers the sum of squares by less: a tenth of one standard deviation squared."""

_FREE = 1e-5
"""A step damped by less, in units of its own curvature, goes nearly as far as it wants to."""


_ROUNDING = 1e-15
"""Eigenvalues of a matrix of ones on its diagonal are known no better."""


class Evaluated(Protocol):
    """A point of the descent; `objective` is what is made small."""

    @property
    def objective(self) -> float:
        """Sum of squares including priors."""


Point = TypeVar("Point", bound=Evaluated)


class Descent(Generic[Point]):
    """A least-squares problem: what to evaluate, its normal equations, its bounds.

    `evaluate` gives a point, `normal` its equations (H, -gradient/2).

    `low` and `high` bound the parameters; `cap` (n,) is how far each may move in one step. `rows` is how many numbers
    of unit variance the sum of squares is of; without it the variance is taken for one.
    """

    def __init__(
        self,
        evaluate: Callable[[Array], Point],
        normal: Callable[[Array, Point], tuple[Array, Array]],
        low: Array,
        high: Array,
        cap: Array,
        rows: int = 0,
    ) -> None:
        self._evaluate, self._normal = evaluate, normal
        self._low, self._high, self._cap = low, high, cap
        self._rows = rows

    def run(self, x: Array, steps: int) -> tuple[Array, Point]:
        """Return the best point found from `x` in at most `steps` steps, and its evaluation."""
        x = np.clip(x, self._low, self._high)
        here = self._evaluate(x)
        damping = 1e-9
        for _ in range(steps if x.size else 0):
            h, slope = self._normal(x, here)
            moved = self._step(x, here, h, slope, damping)
            if moved is None:
                break
            gained = here.objective - moved[1].objective
            x, here, damping = moved
            # where far more than noise is left, so much more is a tenth of a standard deviation
            level = max(1.0, here.objective / self._rows) if self._rows else 1.0
            if gained < _CLOSE * level and damping < _FREE:
                break  # a short step that gains little says nothing; a free one does
        return x, here

    def _step(self, x: Array, here: Point, h: Array, slope: Array, damping: float) -> tuple[Array, Point, float] | None:
        """Return the next point with the damping that found it, or None when no step helps."""
        free = ~((x <= self._low) & (slope < 0.0) | (x >= self._high) & (slope > 0.0))
        scale = np.sqrt(np.maximum(np.diag(h), 1e-300))
        live = free & (scale > 1e-12 * np.max(scale))
        if not live.any():
            return None
        scaled = h[np.ix_(live, live)] / np.outer(scale[live], scale[live])
        while damping < 1e6:
            step = np.zeros(x.size)
            inner = scaled + damping * np.eye(scaled.shape[0])
            step[live] = np.linalg.lstsq(inner, slope[live] / scale[live], rcond=1e-15)[0] / scale[live]
            there = np.clip(x + np.clip(step, -self._cap, self._cap), self._low, self._high)
            found = self._evaluate(there)
            if found.objective < here.objective:
                return there, found, max(damping * 0.1, 1e-12)
            if damping > 1.0 and found.objective - here.objective < 1e-3:
                return None  # so small a step changes nothing: this is the minimum
            damping = max(10.0 * damping, 1e-6)
        return None


def inverse_of(precision: Array) -> Array:
    """Return the inverse of a precision (n, n) whose entries may differ by 10¹⁵ from one parameter to another.

    Scaled to a unit diagonal, or a direction that only the prior determines would be taken for rounding beside a
    parameter that the data know to ten digits.
    """
    scale = np.sqrt(np.diag(precision))
    values, vectors = np.linalg.eigh(precision / np.outer(scale, scale))
    return np.asarray((vectors / np.maximum(values, _ROUNDING)) @ vectors.T / np.outer(scale, scale))
