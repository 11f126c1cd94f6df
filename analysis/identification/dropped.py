"""Modes that a search found and its result has not: nothing is given up without a word."""

from __future__ import annotations

from dataclasses import dataclass

UNDETERMINED = "undetermined by the data"
MERGED = "closer to another one than their widths, and held-out data need only one of the two"
DELAY = "a delay explains the data better"


@dataclass(frozen=True)
class Dropped:
    """A mode that was fitted and given up, and `why`.

    `explained` is the part of the squared residual that it had explained, beyond what the other modes explain without
    it; None where that is not known.
    """

    frequency_hz: float
    frequency_std_hz: float
    decay_rate_1_s: float
    decay_rate_std_1_s: float
    explained: float | None
    why: str
