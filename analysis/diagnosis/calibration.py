"""From a posterior within the library to a calibrated probability: how often names of that posterior were right.

A posterior accounts for noise and for the listed rivals. It cannot account for a law outside of the library, or for a
model discrepancy of a listed one. A score of blind cases shows how often that was so, and no name is stated with a
higher probability than that with which the names of that score were right.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from analysis.diagnosis.tails import share_interval

TABLE = Path(__file__).parent / "calibration.toml"
"""Made by `python -m benchmarks.calibrate_names`, which says from what."""


@dataclass(frozen=True)
class BlindNames:
    """Names with a posterior from `least` on, in the blind cases: how many there were, and how many were right."""

    least: float
    names: int
    right: int

    @property
    def probability(self) -> float:
        """The probability that another such name is right, below one (Laplace's rule of succession)."""
        return (self.right + 1.0) / (self.names + 2.0)

    @property
    def interval(self) -> tuple[float, float]:
        """Its exact interval of 95 %."""
        return share_interval(self.right, self.names)


@cache
def _bins() -> tuple[BlindNames, ...]:
    """Return every bin, by rising posterior."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    return tuple(BlindNames(float(one["least"]), int(one["names"]), int(one["right"])) for one in table["bins"])


def _bin_of(posterior: float) -> BlindNames:
    bins = _bins()
    return next((one for one in reversed(bins) if posterior >= one.least), bins[0])


def counted(posterior: float) -> BlindNames | None:
    """Return the blind cases that the probability of a posterior is counted in; None where that is the posterior."""
    found = _bin_of(posterior)
    return found if found.probability <= posterior else None


def calibrated(posterior: float) -> float:
    """Return the probability that a name of this posterior is right, below one.

    Below the posteriors of the score it is no more than in its lowest bin, nor than the posterior.
    """
    return min(posterior, _bin_of(posterior).probability)
