"""A curve over frequency in thirds of an octave: IEC 61260-1 (2014), of base ten."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PER_DECADE = 10


@dataclass(frozen=True)
class Band:
    """A share, between 0 and 1, in the third of an octave about a frequency."""

    frequency_hz: float
    share: float


def shares_of(frequency_hz: Array, part: Array, total: Array) -> tuple[Band, ...]:
    """Return which share the power `part` (f,) is of `total` (f,), by bands in ascending order; all above zero Hz."""
    number = _numbers(frequency_hz)
    found = []
    for k in np.unique(number):
        within = number == k
        share = float(part[within].sum() / max(total[within].sum(), np.finfo(float).tiny))
        found.append(Band(10.0 ** (int(k) / PER_DECADE), min(max(share, 0.0), 1.0)))
    return tuple(found)


def lowest_of(curves: Sequence[Sequence[Band]]) -> tuple[Band, ...]:
    """Return the lowest share of several curves in each band that one of them has."""
    lowest: dict[float, float] = {}
    for band in (band for curve in curves for band in curve):
        lowest[band.frequency_hz] = min(band.share, lowest.get(band.frequency_hz, 1.0))
    return tuple(Band(frequency_hz, share) for frequency_hz, share in sorted(lowest.items()))


def bands_text(bands: Sequence[Band]) -> str:
    """Return a curve in a line, in percent from the first band to the last, a dash for one without a number."""
    number = _numbers(np.array([band.frequency_hz for band in bands]))
    percent = dict(zip(number.tolist(), (f"{100.0 * band.share:.0f}" for band in bands), strict=True))
    listed = " ".join(percent.get(k, "–") for k in range(min(percent), max(percent) + 1))
    return f"in thirds of an octave, {bands[0].frequency_hz:.3g} to {bands[-1].frequency_hz:.3g} Hz: {listed} %"


def _numbers(frequency_hz: Array) -> NDArray[np.int64]:
    return np.rint(PER_DECADE * np.log10(frequency_hz)).astype(np.int64)
