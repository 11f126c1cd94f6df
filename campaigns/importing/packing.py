"""Numbers that HDF5 and NetCDF files keep packed: scale factor, offset and fill value.

Source: CF conventions 1.11, sections 2.5.1 and 8.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

PACKING = ("scale_factor", "add_offset", "_FillValue", "missing_value", "valid_min", "valid_max", "valid_range")
"""Attributes that say how packed numbers are to be read."""


def unpacked(values: NDArray[Any], attributes: Mapping[str, Any]) -> NDArray[Any]:
    """Return numbers as the attributes mean them; where a number is missing there stands not-a-number.

    Values equal to the fill value, or outside of the valid range, are missing; both are told in packed numbers.
    """
    known = {name: value for name, value in attributes.items() if value is not None and not isinstance(value, str)}
    if not known or values.dtype.kind not in "fiu":
        return values
    missing = np.zeros(values.shape, dtype=bool)
    for name in ("_FillValue", "missing_value"):
        if name in known:
            missing |= np.isin(values, np.asarray(known[name]))
    low, high = known.get("valid_range", (known.get("valid_min"), known.get("valid_max")))
    if low is not None:
        missing |= values < low
    if high is not None:
        missing |= values > high
    if not missing.any() and not {"scale_factor", "add_offset"} & set(known):
        return values
    numbers = values.astype(np.float64) * float(known.get("scale_factor", 1.0)) + float(known.get("add_offset", 0.0))
    numbers[missing] = np.nan
    return numbers
