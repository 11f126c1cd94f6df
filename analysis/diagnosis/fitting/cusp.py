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

_CLOSE = 0.1
"""A pass that gains less (twice a log-likelihood) was the last."""


def sharpened(objective: Callable[[float], float], at: float, reach: float) -> tuple[float, float]:
    """Return where `objective`, twice a negative log-likelihood, is least within `reach` of `at`, and the deviation.

    The standard deviation is that of the likelihood itself, all else being held; infinite where it does not end.
    """
    distances = reach * np.geomspace(1.0, _FINEST, _DISTANCES)

    def around() -> Array:
        """Return how much higher the objective is at every distance on either side, shape (2, n)."""
        return np.array([[objective(at + side * d) - here for d in distances] for side in (-1.0, 1.0)])

    here = objective(at)
    higher = around()
    for _ in range(_PASSES):
        side, lowest = np.unravel_index(int(np.argmin(higher)), higher.shape)
        if higher[side, lowest] > -_CLOSE:
            break
        at += float((-1.0, 1.0)[side] * distances[lowest])
        here = objective(at)
        higher = around()
    return at, _deviation(distances, higher)


def _deviation(distances: Array, higher: Array) -> float:
    """Return the root of the mean squared distance under the likelihood, `higher` (2, n) at `distances` both ways.

    Infinite where the likelihood does not end there: the data say nothing then.
    """
    if float(np.min(higher[:, 0])) < _FLAT:
        return np.inf
    at = np.concatenate([[0.0], distances[::-1]])
    likelihood = np.append(2.0, np.exp(-0.5 * np.maximum(higher[:, ::-1], 0.0)).sum(axis=0))
    return float(np.sqrt(np.trapezoid(likelihood * at**2, at) / np.trapezoid(likelihood, at)))
