"""Descents: Gauss-Newton in a trusted region from normal equations, and along a parameter whose misfit has a cusp.

General least-squares routines stop when a sum of squares changes little *relative* to itself. Here the sum of squares
is a likelihood: a change of a tenth is convergence at any size, and a change of a hundred is evidence even where it
is 1e-4 of the whole.

A command is rounded to one step or to another. Near the true step those samples come out wrong that lie near a
threshold, one after another as the distance grows, so the misfit rises like a roof on both sides: there is no slope to
descend along, and the curvature at a point, that of samples which all stay on their level, is far too large. Such a
parameter is sought without slopes, and its deviation is read off the misfit itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from sim_backend.linear import Array

_CLOSE, _NOTHING = 0.1, 0.01
"""A descent ends when a step lowers the sum of squares by less than the first, or promises less than the second: a
tenth of a standard deviation, squared or not."""

_KEPT, _WORSE = 0.75, 0.25
"""Parts of what a step promised beyond which the next one may be longer, and below which it has to be shorter."""

_SHORTER, _LONGER, _FAILURES = 0.25, 4.0, 12
"""How much shorter a step is after one that failed, and how much longer it may be after one that kept its promise; how
often one fails until nothing moves."""

_TRIES = 2
"""Failures at one point from which on the slopes are likely wrong, rather than the steps too long."""

_ROUNDING = 1e-15
"""Eigenvalues of a matrix of ones on its diagonal are known no better."""

_ENOUGH = 0.05
"""How well the logarithm of a damping is found."""

_DISTANCES, _FINEST = 48, 2.0**-24
"""How many distances are tried on either side, and the smallest in parts of the widest."""

_PASSES = 20

_FLAT = 6.0
"""Rise of the objective at the widest distance that ends a likelihood: it has fallen to a twentieth."""

_SPARSE = 3
"""One in so many distances is tried first: while those still gain, the ones between are not needed."""


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
        """Return the normal equations at `x` (n,): H (n, n) and -gradient/2 (n,)."""

    def fresh(self) -> bool:
        """Tell whether the last slopes were those of the point itself; if not, the next ones will be."""

    def truer(self) -> bool:
        """Tell whether there are more exact slopes, which are used from then on."""

    def failed(self) -> bool:
        """Tell the same of slopes that have led astray."""


class Descent(Generic[Point]):
    """A least-squares problem: what to evaluate, its slopes, its bounds.

    `low` and `high` bound the parameters; `cap` (n,) is how far each may move in one step. `rows` is how many numbers
    of unit variance the sum of squares has; without it the variance is taken as one. An `exact` descent ends only
    where the most exact slopes there are, those of the point itself, promise no further gain.
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
        self._poor, self._trusted = 0, np.inf  # steps that kept little of their promise, and the length of the first

    def run(self, x: Array, steps: int) -> tuple[Array, Point]:
        """Return the best point (n,) found from `x` (n,) in at most `steps` steps, and its evaluation."""
        x = np.clip(x, self._low, self._high)
        here, radius = self._evaluate(x), np.inf
        self._poor, self._trusted = 0, radius
        for _ in range(steps if x.size else 0):
            moved = self._step(x, here, radius)
            if moved is None:
                break
            gained = here.objective - moved[1].objective
            x, here, radius, free = moved
            if gained < _CLOSE * self._level(here) and not self._improved(sure=free):
                break
        return x, here

    def _level(self, at: Point) -> float:
        """Return the unit of a change: a residual far above the noise enlarges a standard deviation by as much."""
        return max(1.0, at.objective / self._rows) if self._rows else 1.0

    def _improved(self, *, sure: bool) -> bool:
        """Tell whether more exact slopes pay where these promise no gain; `sure` of one that is free."""
        if sure and not self._exact:
            return False
        return not self._slopes.fresh() or self._slopes.truer()

    def _step(self, x: Array, here: Point, radius: float) -> tuple[Array, Point, float, bool] | None:
        """Return the next point, the radius of the step after it, and whether the step was free; None if none helps."""
        way, failures = self._way(x, here), self._poor
        while failures < self._poor + _FAILURES:
            wanted = way.within(radius)
            promised, step = self._allowed(x, wanted, way)
            if promised < _NOTHING * self._level(here):
                if step is not wanted:  # of a shorter one less is cut off
                    radius, failures = _SHORTER * way.length(wanted), failures + 1
                elif self._improved(sure=_within(way.length(step), radius)):
                    way = self._way(x, here)
                else:
                    return None
                continue
            found = self._evaluate(x + step)
            gained = here.objective - found.objective
            kept, length = gained / promised, way.length(step)
            misled = kept < _WORSE and self._misled(failures)
            if misled:
                radius = self._as_before(radius)
            if gained > 0.0:
                following = radius if misled else self._following(radius, length, kept)
                return x + step, found, following, _within(length, radius)
            if misled:
                way, failures = self._way(x, here), 0
            else:
                radius, failures = _SHORTER * length, failures + 1
        return None

    def _as_before(self, radius: float) -> float:
        """Return the radius from before steps were poor ones: that was the fault of the slopes, not of their length."""
        if self._poor:
            self._poor, radius = 0, self._trusted
        return radius

    def _following(self, radius: float, length: float, kept: float) -> float:
        """Return the radius of the step after one of this length that `kept` a part of what it promised."""
        if kept >= _WORSE:
            self._poor = 0
            return radius if kept < _KEPT else np.inf if _within(length, radius) else _LONGER * radius
        if not self._poor:
            self._trusted = length
        self._poor += 1
        return 2.0 * _SHORTER * length

    def _misled(self, failures: int) -> bool:
        """Tell whether the slopes are wrong, rather than a step too long; others are used then."""
        return not self._slopes.fresh() or (failures >= _TRIES and self._slopes.failed())

    def _way(self, x: Array, here: Point) -> _Way:
        """Return what the slopes say of the steps from `x`, along what is not held at a bound."""
        h, slope = self._slopes.normal(x, here)
        held = (x <= self._low) & (slope < 0.0) | (x >= self._high) & (slope > 0.0)
        return _Way(h, slope, ~held)

    def _allowed(self, x: Array, step: Array, way: _Way) -> tuple[float, Array]:
        """Return by how much a step is to lower the sum of squares, and the step; the better of two where it is cut.

        Cut off parameter by parameter it may lead up; shortened as a whole, it may be held up by the one that matters
        least.
        """
        low, high = np.maximum(self._low - x, -self._cap), np.minimum(self._high - x, self._cap)
        if np.all((low <= step) & (step <= high)):
            return way.promises(step), step
        room = np.where(step < 0.0, low, high)
        part = np.min(np.divide(room, step, out=np.ones_like(step), where=step != 0.0))
        ways = [np.clip(step, low, high), min(part, 1.0) * step]
        return max(((way.promises(s), s) for s in ways), key=lambda pair: pair[0])


class _Way:
    """What normal equations (H, -gradient/2) say of the steps from a point, along the parameters that are `free`.

    Lengths are in units of each parameter's own curvature.
    """

    def __init__(self, h: Array, slope: Array, free: NDArray[np.bool_]) -> None:
        self._h, self._slope = h, slope
        self._scale = np.sqrt(np.maximum(np.diag(h), 1e-300))
        self._live = free & (self._scale > 1e-12 * np.max(self._scale))
        own = self._scale[self._live]
        self._values, self._vectors = np.linalg.eigh(h[np.ix_(self._live, self._live)] / np.outer(own, own))
        self._along = self._vectors.T @ (slope[self._live] / own)

    def promises(self, step: Array) -> float:
        """Return by how much a step would lower the sum of squares."""
        return float(2.0 * self._slope @ step - step @ self._h @ step)

    def length(self, step: Array) -> float:
        """Return the length of a step."""
        return float(np.linalg.norm(step * self._scale))

    def within(self, radius: float) -> Array:
        """Return the best step that is no longer than `radius`: damped so much that it ends there (Levenberg 1944)."""
        values = np.maximum(self._values, _ROUNDING)

        def damped(logarithm: float) -> Array:
            return np.asarray(self._along / (values + np.exp(logarithm)))

        least, most = np.log(_ROUNDING), np.log(max(float(np.linalg.norm(self._along)) / radius, _ROUNDING))
        if np.linalg.norm(damped(least)) <= radius:
            most = least
        while most - least > _ENOUGH:
            middle = 0.5 * (least + most)
            least, most = (middle, most) if np.linalg.norm(damped(middle)) > radius else (least, middle)
        step = np.zeros(self._scale.size)
        step[self._live] = self._vectors @ damped(most) / self._scale[self._live]
        return step


def _within(length: float, radius: float) -> bool:
    """Tell whether a step has not been shortened to a radius."""
    return length < 0.9 * radius


def inverse_of(precision: Array) -> Array:
    """Return the inverse of a precision (n, n) whose entries may differ by 10¹⁵ from one parameter to another.

    Scaled to a unit diagonal, or a direction that only the prior determines would be taken for rounding beside a
    parameter that the data know to ten digits.
    """
    scale = np.sqrt(np.diag(precision))
    values, vectors = np.linalg.eigh(precision / np.outer(scale, scale))
    return np.asarray((vectors / np.maximum(values, _ROUNDING)) @ vectors.T / np.outer(scale, scale))


def sharpened(objective: Callable[[float], float], at: float, reach: float, close: float) -> tuple[float, float]:
    """Return where `objective`, twice a negative log-likelihood, is least within `reach` of `at`, and the deviation.

    A step that gains less than `close` is not taken. The standard deviation is that of the likelihood itself, with all
    else fixed; infinite where the likelihood does not fall off.
    """
    distances = _distances(reach)
    for _ in range(_PASSES):
        step, higher = _around(objective, at, distances, close)
        if not step:
            break
        at += step
    else:
        higher = _around(objective, at, distances, np.inf)[1]
    return at, _deviation(distances, higher)


def approached(objective: Callable[[float], float], at: float, reach: float, close: float) -> float:
    """Return a point near which `sharpened` would end, by steps of the sparse distances alone."""
    distances = _distances(reach)[::_SPARSE]
    for _ in range(_PASSES):
        step, _ = _around(objective, at, distances, close)
        if not step:
            break
        at += step
    return at


def _distances(reach: float) -> Array:
    return reach * np.geomspace(1.0, _FINEST, _DISTANCES)


def _around(objective: Callable[[float], float], at: float, distances: Array, close: float) -> tuple[float, Array]:
    """Return the best step that gains `close`, zero for none, and by how much `objective` is higher around, (2, n).

    Some of that is not known, and infinite, where there is such a step.
    """
    here, higher = objective(at), np.full((2, distances.size), np.inf)
    for first in range(_SPARSE):
        some = distances[first::_SPARSE]
        higher[:, first::_SPARSE] = [[objective(at + side * d) - here for d in some] for side in (-1.0, 1.0)]
        side, lowest = np.unravel_index(int(np.argmin(higher)), higher.shape)
        if higher[side, lowest] < -close:
            return float((-1.0, 1.0)[side] * distances[lowest]), higher
    return 0.0, higher


def _deviation(distances: Array, higher: Array) -> float:
    """Return the root of the mean squared distance under the likelihood, `higher` (2, n) at `distances` both ways.

    Infinite where the likelihood does not fall off: the data do not determine it. Never less than the smallest
    distance, within which nothing was evaluated.
    """
    if float(np.min(higher[:, 0])) < _FLAT:
        return np.inf
    at = np.concatenate([[0.0], distances[::-1]])
    likelihood = np.append(2.0, np.exp(-0.5 * np.maximum(higher[:, ::-1], 0.0)).sum(axis=0))
    squared = np.trapezoid(likelihood * at**2, at) / np.trapezoid(likelihood, at)
    return max(float(np.sqrt(squared)), float(distances[-1]))
