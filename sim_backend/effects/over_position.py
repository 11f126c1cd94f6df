"""What of a residual repeats over the position: after which distance, and whether as a rounding does."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

READING_DISTANCES = 16384
"""Distances over which a residual is compared with itself: from half the range of positions to so small a part of it.
An interferometer's error repeats after a third of a micrometre, and over millimetres."""

_BINS = 4 * READING_DISTANCES

_MOST_TRIED = 512
"""Steps that are tried about one distance: where more would differ at the positions, their zero is too far away."""


@dataclass(frozen=True)
class OverPosition:
    """A residual averaged in bins over the range of positions, `rough` (bins,): without what is smooth over all of it.

    Bins in which no position is are zero; the range begins at `low`, and `width` is its length.
    """

    low: float
    width: float
    rough: Array

    @classmethod
    def of(cls, position: Array, residual: Array) -> OverPosition | None:
        """Return the average of a residual (n,) over positions (n,); None where these do not move."""
        width = float(np.ptp(position)) if position.size else 0.0
        if not width > 0.0:
            return None
        low = float(np.min(position))
        bins = np.minimum(((position - low) / width * _BINS).astype(np.int64), _BINS - 1)
        count = np.bincount(bins, minlength=_BINS)
        mean = np.bincount(bins, weights=residual, minlength=_BINS) / np.maximum(count, 1)
        at = np.linspace(-1.0, 1.0, _BINS)
        # what is smooth over the whole range is another effect
        smooth = np.polynomial.polynomial.polyfit(at, mean, 3, w=np.sqrt(count))
        return cls(low, width, np.where(count > 0, mean - np.polynomial.polynomial.polyval(at, smooth), 0.0))

    def periods(self, n: int) -> list[float]:
        """Return the `n` distances after which it repeats most, from half the range to the smallest."""
        power = self._power.copy()
        periods: list[float] = []
        for _ in range(n):
            i = max(int(np.argmax(power)), 8)
            periods.append(self.width * 4.0 / i)
            power[max(0, i - 8) : i + 9] = 0.0
        return periods

    @cached_property
    def _power(self) -> Array:
        """The spectrum (bins,) over the position, without what repeats less than twice: used by several effects."""
        power = np.abs(np.fft.rfft(self.rough * np.hanning(_BINS), 4 * _BINS))[:_BINS] ** 2
        power[:8] = 0.0
        return np.asarray(power)

    def steps(self, n: int) -> list[float]:
        """Return, near each of `n` such distances, the step of a rounding that it resembles most.

        The error of a rounding to steps q is a sawtooth through zero, whose first harmonic is -(q/π) sin(2π x/q). So
        the phase at the positions tells the step far better than the distance between two peaks does.
        """
        at = np.flatnonzero(self.rough)
        x = self.low + (at + 0.5) * (self.width / _BINS)
        farthest = float(np.max(np.abs(x), initial=0.0))
        found = []
        for period in self.periods(n):
            about = 0.5 / self.width
            tried = int(min(np.ceil(16.0 * about * farthest), _MOST_TRIED)) // 2
            waves = 1.0 / period + np.linspace(-about, about, 2 * tried + 1)
            alike = [-float(self.rough[at] @ np.sin(2.0 * np.pi * wave * x)) for wave in waves]
            found.append(1.0 / float(waves[int(np.argmax(alike))]))
        return found
