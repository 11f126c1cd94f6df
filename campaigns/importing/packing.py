"""Numbers that HDF5 and NetCDF files keep packed: scale factor, offset and fill value.

Source: CF conventions 1.11, sections 2.5.1 and 8.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backend.errors import DataError

PACKING = ("scale_factor", "add_offset", "_FillValue", "missing_value", "valid_min", "valid_max", "valid_range")
"""Attributes that say how packed numbers are to be read."""


def unpacked(values: NDArray[Any], attributes: Mapping[str, Any]) -> NDArray[Any]:
    """Return numbers, any shape, as the attributes mean them; not-a-number where one is missing.

    The result has the shape of `values`. Values equal to the fill value, or outside of the valid range, are missing;
    both are stated in packed numbers. Raises DataError for an attribute that is not a number.
    """
    known: dict[str, NDArray[Any]] = {}
    for name, value in attributes.items():
        if value is None or name not in PACKING:
            continue
        try:
            known[name] = np.atleast_1d(np.asarray(value, dtype=np.float64))
        except (TypeError, ValueError):
            shown = str(value)[:40]
            raise DataError(f"its attribute {name} is '{shown}', which is not a number: repair the file") from None
    if not known or values.dtype.kind not in "fiu":
        return values
    missing = np.zeros(values.shape, dtype=bool)
    for name in ("_FillValue", "missing_value"):
        if name in known:
            missing |= np.isin(values, known[name])
    limits = known.get("valid_range", np.array([]))
    low, high = limits if limits.size == 2 else (known.get("valid_min"), known.get("valid_max"))
    if low is not None:
        missing |= values < np.min(low)
    if high is not None:
        missing |= values > np.max(high)
    if not missing.any() and not {"scale_factor", "add_offset"} & set(known):
        return values
    numbers = values.astype(np.float64)
    if "scale_factor" in known:
        numbers = numbers * known["scale_factor"].flat[0]
    if "add_offset" in known:
        numbers = numbers + known["add_offset"].flat[0]
    numbers[missing] = np.nan
    return numbers
