"""From a posterior within the library to a calibrated probability: how often names of that posterior were right.

A posterior accounts for noise and for the listed rivals. It cannot account for a law outside of the library, or for a
model discrepancy of a listed one. A score of blind cases shows how often that was so, and no name is stated with a
higher probability than that with which the names of that score were right.
"""

from __future__ import annotations

import tomllib
from functools import cache
from pathlib import Path

TABLE = Path(__file__).parent / "calibration.toml"
"""Made by `python -m benchmarks.calibrate_names`, which says from what."""


@cache
def _bins() -> tuple[tuple[float, int, int], ...]:
    """Return (least posterior, names, right ones) of every bin, by rising posterior."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    return tuple((float(one["least"]), int(one["names"]), int(one["right"])) for one in table["bins"])


def calibrated(posterior: float) -> float:
    """Return the probability that a name of this posterior is right, below one (Laplace's rule of succession).

    Below the posteriors of the score it is no more than in its lowest bin, nor than the posterior.
    """
    bins = _bins()
    _, names, right = next((one for one in reversed(bins) if posterior >= one[0]), bins[0])
    return min(posterior, (right + 1.0) / (names + 2.0))
