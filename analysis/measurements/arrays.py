"""What every measurement asks of its input, asked in one place."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_backend.errors import DataError

Array = NDArray[np.float64]

MOST = 1e60
"""Beyond any reading in SI units, and such that the fifth powers and squares of squares that are formed stay finite."""


def finite(what: str, values: ArrayLike, ndim: int, least: int = 2, axis: int = 0) -> Array:
    """Return `values` as an array of floats.

    Raises DataError unless it has `ndim` dimensions, at least `least` entries along `axis` and finite numbers only;
    `what` opens the message.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim != ndim or array.shape[axis] < least:
        raise DataError(f"{what}: shape {array.shape}; give {ndim} dimensions with {least} or more along axis {axis}")
    if (first := first_absurd(array)) is not None:
        raise DataError(f"{what}: entry {first} is {said(array[first])}; leave that stretch out")
    return array


def first_absurd(values: Array) -> tuple[int, ...] | None:
    """Return the place of the first entry that no sensor reads, not finite or beyond MOST; None where there is none."""
    if (
        not values.size or max(float(np.max(values)), -float(np.min(values))) <= MOST
    ):  # false for NaN, which both pass on
        return None
    return tuple(int(i) for i in np.argwhere(~(np.abs(values) <= MOST))[0])


def said(value: float) -> str:
    """Return what is wrong with an entry that no sensor reads."""
    return f"{value:.3g}, beyond what any sensor reads" if np.isfinite(value) else f"not finite ({value})"


def positive(what: str, value: float) -> float:
    """Return `value`; raises DataError unless it is finite and above zero."""
    if not (np.isfinite(value) and value > 0.0):
        raise DataError(f"{what} is {value}; it must be a finite number above zero")
    return float(value)
