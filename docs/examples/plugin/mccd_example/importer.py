"""Files `NAME.pairs`: lines `name [unit]: value value …`, an array each."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

LINE = re.compile(r"(?P<name>[^\[:]+?)\s*(?:\[(?P<unit>[^\]]*)\])?\s*:(?P<values>.*)")


def read_pairs(path: Path) -> dict[str, tuple[NDArray[np.float64], str]]:
    """Return the arrays (n,) of a file by name, each with its unit; mccd calls this in a process of its own."""
    arrays = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        found = LINE.fullmatch(line.strip())
        if found is None:
            raise ValueError(f"'{line[:60]}' is not a line 'name [unit]: values'")
        arrays[found["name"]] = (np.array(found["values"].split(), dtype=float), found["unit"] or "1")
    return arrays
