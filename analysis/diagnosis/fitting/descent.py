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

_CLOSE, _NOTHING = 0.1, 0.01
"""A descent ends when a step lowers the sum of squares by less than the first, or promises less than the second: a
tenth of a standard deviation, squared or not."""

_KEPT, _WORSE = 0.75, 0.25
"""Parts of what a step promised beyond which the next one is damped less, and below which it is damped more."""

_LEAST, _FIRST, _STIFF, _MOST = 1e-9, 1e-3, 0.1, 1e6
"""Damping of a step that does what it promised, and that of the next after one that failed; one from which on it is
rather the slopes that fail than the step that is too long; and one at which nothing moves.

What was tried without success at the least hardly differs below a thousandth of the curvature.
"""


_ROUNDING = 1e-15
"""Eigenvalues of a matrix of ones on its diagonal are known no better."""


class Evaluated(Protocol):
    """A point of the descent; `objective` is what is made small."""

    @property
    def objective(self) -> float:
        """Sum of squares including priors."""


Point = TypeVar("Point", bound=Evaluated)
At = TypeVar("At", bound=Evaluated, contravariant=True)


class Slopes(Protocol[At]):
    """Where a descent gets its normal equations from: cheaply as long as they serve."""

    def normal(self, x: Array, at: At) -> tuple[Array, Array]:
        """Return the normal equations (H, -gradient/2) at `x`."""

    def fresh(self) -> bool:
        """Tell whether the last ones were of the place itself; if not, they will be when they are asked for again."""

    def truer(self) -> bool:
        """Tell whether there are truer ones, which is what is asked for from then on."""


class Descent(Generic[Point]):
    """A least-squares problem: what to evaluate, its slopes, its bounds.

    `low` and `high` bound the parameters; `cap` (n,) is how far each may move in one step. `rows` is how many numbers
    of unit variance the sum of squares is of; without it the variance is taken for one. An `exact` descent ends only
    where the truest slopes there are, those of the place itself, promise nothing more.
    """

    def __init__(
        self,
        evaluate: Callable[[Array], Point],
        slopes: Slopes[Point],
        low: Array,
        high: Array,
        cap: Array,
        rows: int = 0,
        *,
        exact: bool = True,
    ) -> None:
        self._evaluate, self._slopes = evaluate, slopes
        self._low, self._high, self._cap = low, high, cap
        self._rows, self._exact = rows, exact

    def run(self, x: Array, steps: int) -> tuple[Array, Point]:
        """Return the best point found from `x` in at most `steps` steps, and its evaluation."""
        x = np.clip(x, self._low, self._high)
        here, damping = self._evaluate(x), _LEAST
        for _ in range(steps if x.size else 0):
            moved = self._step(x, here, damping)
            if moved is None:
                break
            gained = here.objective - moved[1].objective
            x, here, damping = moved
            if gained < _CLOSE * self._level(here) and not self._improved(sure=damping < _FIRST):
                break
        return x, here

    def _level(self, at: Point) -> float:
        """Return the unit of a change: where far more than noise is left, so much more is a standard deviation."""
        return max(1.0, at.objective / self._rows) if self._rows else 1.0

    def _improved(self, *, sure: bool) -> bool:
        """Tell whether better slopes are worth asking for where these promise no more; `sure` of one that is free."""
        if sure and not self._exact:
            return False
        return not self._slopes.fresh() or self._slopes.truer()

    def _step(self, x: Array, here: Point, damping: float) -> tuple[Array, Point, float] | None:
        """Return the next point and the damping of the step after it, or None when no step helps."""
        normal = self._slopes.normal(x, here)
        while damping < _MOST:
            step, cut = self._damped(x, *normal, damping)
            promised = float(2.0 * normal[1] @ step - step @ normal[0] @ step)
            if promised < _NOTHING * self._level(here):
                if cut:  # what is left of a step need not lead down: of a shorter one less is cut off
                    damping = max(10.0 * damping, _FIRST)
                elif self._improved(sure=damping < _STIFF):
                    normal = self._slopes.normal(x, here)
                else:
                    return None
                continue
            found = self._evaluate(x + step)
            gained = here.objective - found.objective
            kept = gained / promised
            misled = kept < _WORSE and self._misled(damping)
            if gained > 0.0:
                return x + step, found, damping if misled else _next(damping, kept)
            if misled:
                normal = self._slopes.normal(x, here)
            else:
                damping = _next(damping, kept)
        return None

    def _misled(self, damping: float) -> bool:
        """Tell whether rather the slopes fail than a step of this damping is too long; others are asked for then."""
        return not self._slopes.fresh() or (damping > _STIFF and self._slopes.truer())

    def _damped(self, x: Array, h: Array, slope: Array, damping: float) -> tuple[Array, bool]:
        """Return a step that stays within the bounds, and whether some of it had to be cut off for that."""
        free = ~((x <= self._low) & (slope < 0.0) | (x >= self._high) & (slope > 0.0))
        scale = np.sqrt(np.maximum(np.diag(h), 1e-300))
        live = free & (scale > 1e-12 * np.max(scale))
        step = np.zeros(x.size)
        if live.any():
            inner = h[np.ix_(live, live)] / np.outer(scale[live], scale[live]) + damping * np.eye(int(live.sum()))
            step[live] = np.linalg.lstsq(inner, slope[live] / scale[live], rcond=1e-15)[0] / scale[live]
        within = np.clip(x + np.clip(step, -self._cap, self._cap), self._low, self._high) - x
        return within, bool(np.any(np.abs(within - step) > 1e-9 * np.abs(step)))


def _next(damping: float, kept: float) -> float:
    """Return the damping of the step after one that `kept` this part of its promise, less than nothing if it led up."""
    if kept < _WORSE:
        return max(10.0 * damping, _FIRST)
    return damping if kept < _KEPT else 0.1 * damping if damping > _FIRST else _LEAST


def inverse_of(precision: Array) -> Array:
    """Return the inverse of a precision (n, n) whose entries may differ by 10¹⁵ from one parameter to another.

    Scaled to a unit diagonal, or a direction that only the prior determines would be taken for rounding beside a
    parameter that the data know to ten digits.
    """
    scale = np.sqrt(np.diag(precision))
    values, vectors = np.linalg.eigh(precision / np.outer(scale, scale))
    return np.asarray((vectors / np.maximum(values, _ROUNDING)) @ vectors.T / np.outer(scale, scale))
