"""Dropped samples: now and then a reading does not arrive and the last one is repeated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_backend.effects.base import Array, Effect, Site, shape
from sim_backend.effects.view import RecordView


@dataclass(frozen=True)
class DroppedSamples(Effect):
    """A share `fraction` of the samples, at random, repeats the one before; neutral at zero."""

    name = "dropped-samples"
    family = "surroundings"
    site = Site.RECORD
    symptom = "has single samples that repeat the one before and are off by one sample's motion"

    fraction: float = shape("share of the samples that is lost", 0.0, high=0.99)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the share of the record's samples that repeat the one before, or nothing when none does."""
        repeats = float(np.mean(np.diff(view.position) == 0.0)) if view.position.size > 1 else 0.0
        return [{"fraction": min(repeats, 0.99)}] if repeats > 0.0 else []

    def rewrite(self, values: Array, rate_hz: float, rng: np.random.Generator | None = None) -> Array:
        """Return `values` (n,) with samples lost; the first always arrives."""
        if rng is None or self.fraction == 0.0:
            return values
        lost = rng.random(values.size) < self.fraction
        return values[np.maximum.accumulate(np.where(lost, 0, np.arange(values.size)))]
