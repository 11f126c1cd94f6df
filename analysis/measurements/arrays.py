"""The checks of its input that all measurements share."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_backend.errors import DataError
from sim_backend.readings import first_absurd, said

Array = NDArray[np.float64]


def finite(what: str, values: ArrayLike, ndim: int, least: int = 2, axis: int = 0) -> Array:
    """Return `values`, any shape, as an array of floats.

    Raises DataError unless it has `ndim` dimensions, at least `least` entries along `axis` and finite numbers only;
    `what` opens the message.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim != ndim or array.shape[axis] < least:
        raise DataError(f"{what}: shape {array.shape}; give {ndim} dimensions with {least} or more along axis {axis}")
    if (first := first_absurd(array)) is not None:
        raise DataError(f"{what}: entry {first} is {said(array[first])}; leave that stretch out")
    return array


def positive(what: str, value: float) -> float:
    """Return `value`; raises DataError unless it is finite and above zero."""
    if not (np.isfinite(value) and value > 0.0):
        raise DataError(f"{what} is {value}; it must be a finite number above zero")
    return float(value)
