"""What can be the reading of a sensor, in SI units: neither what is not finite nor a number beyond any quantity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST = 1e60
"""Beyond any reading, and such that the fifth powers and squares of squares that are formed stay finite."""


LEAST = 1e-60
"""Below any quantity that is not zero, for the same reason."""


def first_absurd(values: Array) -> tuple[int, ...] | None:
    """Return the position of the first of `values`, any shape, that no sensor reads; None where there is none."""
    if (
        not values.size or max(float(np.max(values)), -float(np.min(values))) <= MOST
    ):  # false for NaN, which both pass on
        return None
    return tuple(int(i) for i in np.argwhere(~(np.abs(values) <= MOST))[0])


def said(value: float) -> str:
    """Return what is wrong with an entry that no sensor reads."""
    return f"{value:.3g}, beyond what any sensor reads" if np.isfinite(value) else f"not finite ({value})"


def with_gaps(values: Array) -> Array:
    """Return `values`, any shape, with NaN for all that no sensor reads; the very same array where there is none."""
    return values if first_absurd(values) is None else np.where(np.abs(values) <= MOST, values, np.nan)
