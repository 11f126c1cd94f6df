"""A parameter over which a misfit has a cusp: sought without slopes, its width read off the misfit itself.

A command is rounded to one step or to another. Near the true step those samples come out wrong that lie near a
threshold, one after another as the distance grows, so the misfit rises like a roof on both sides: there is no slope to
descend along, and the curvature at a point, that of samples which all stay on their level, is far too large.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_DISTANCES, _FINEST = 48, 2.0**-24
"""How many distances are tried on either side, and the smallest in parts of the widest."""

_PASSES = 20
_FLAT = 6.0
"""Rise of the objective at the widest distance that ends a likelihood: a twentieth is left."""

_SPARSE = 3
"""One in so many distances is tried first: while those still gain, the ones between are not needed."""


def sharpened(objective: Callable[[float], float], at: float, reach: float, close: float) -> tuple[float, float]:
    """Return where `objective`, twice a negative log-likelihood, is least within `reach` of `at`, and the deviation.

    A step that gains less than `close` is none. The standard deviation is that of the likelihood itself, all else being
    held; infinite where it does not end.
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

    Infinite where the likelihood does not end there: the data say nothing then.
    """
    if float(np.min(higher[:, 0])) < _FLAT:
        return np.inf
    at = np.concatenate([[0.0], distances[::-1]])
    likelihood = np.append(2.0, np.exp(-0.5 * np.maximum(higher[:, ::-1], 0.0)).sum(axis=0))
    return float(np.sqrt(np.trapezoid(likelihood * at**2, at) / np.trapezoid(likelihood, at)))
