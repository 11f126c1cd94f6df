"""Sample-clock error: a reading is taken by a clock that runs fast or slow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_backend.effects.base import Array, Effect, Site, size


@dataclass(frozen=True)
class SampleClockError(Effect):
    """Sample k of the reading is taken at k (1 + relative) sample times instead of k.

    Between samples a cubic through the four nearest is read; past the end the last value stays.
    """

    name = "sample-clock-error"
    family = "surroundings"
    site = Site.RECORD
    exact = True
    symptom = "is proportional to the rate and grows steadily with time"

    relative: float = size("relative error of the sample time", low=-0.1, high=0.1)

    def rewrite(self, values: Array, rate_hz: float, rng: np.random.Generator | None = None) -> Array:
        """Return `values` (n,) as read by the wrong clock."""
        n = values.size
        if self.is_neutral() or n < 4:
            return values
        at = np.minimum(np.arange(n) * (1.0 + self.relative), n - 1.0)
        first = np.clip(np.floor(at).astype(np.int64) - 1, 0, n - 4)
        t = at - first
        # Lagrange's polynomials on the nodes 0, 1, 2, 3
        weights = (
            (1.0 - t) * (2.0 - t) * (3.0 - t) / 6.0,
            t * (2.0 - t) * (3.0 - t) / 2.0,
            t * (t - 1.0) * (3.0 - t) / 2.0,
            t * (t - 1.0) * (t - 2.0) / 6.0,
        )
        return sum((w * values[first + i] for i, w in enumerate(weights)), np.zeros(n))
