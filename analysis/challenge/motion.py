"""What a run plays, and the true motion that comes of it, on the fine grid of the hidden bench."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SUBSTEPS = 8
"""Fine steps per sample."""


@dataclass(frozen=True)
class Excitation:
    """What one run plays: `command` (n, axes), `temperature_k` (n,); `reference_k` is that of the campaign's start."""

    command: Array
    temperature_k: Array
    rate_hz: float
    reference_k: float
    substeps: int = SUBSTEPS

    @property
    def n(self) -> int:
        """Number of samples."""
        return int(self.command.shape[0])

    @property
    def fine_s(self) -> float:
        """The fine time step."""
        return 1.0 / (self.rate_hz * self.substeps)

    def fine(self, values: Array) -> Array:
        """Return `values` (n, …) held on the fine grid."""
        return np.asarray(np.repeat(values, self.substeps, axis=0))

    def fine_time_s(self) -> Array:
        """Return the middle of every fine step, shape (n · substeps,)."""
        return np.asarray((np.arange(self.n * self.substeps) + 0.5) * self.fine_s, dtype=float)


@dataclass(frozen=True)
class Motion:
    """The true motion: `position` and `rate` (n · substeps, axes) at the beginning of each fine step."""

    position: Array
    rate: Array
    substeps: int

    def sampled(self) -> Array:
        """Return the positions at the samples, shape (n, axes)."""
        return np.ascontiguousarray(self.position[:: self.substeps])
