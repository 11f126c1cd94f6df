"""Sensor quantisation: the reading comes in whole steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim_backend.effects.base import Effect, Site, shape
from sim_backend.effects.over_position import READING_DISTANCES
from sim_backend.effects.rounding import Rounding
from sim_backend.effects.view import RecordView


@dataclass(frozen=True)
class SensorQuantisation(Rounding, Effect):
    """The reading rounded to whole steps; neutral at a step of zero."""

    name = "sensor-quantisation"
    family = "sensor"
    site = Site.READING
    symptom = "is a sawtooth over the reading, bounded however far it moves"

    step_size: float = shape("smallest change of the reading", 0.0, y=1)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the usual distance between neighbouring values of the position, steps that span the swing, and others.

        These are the steps near which the residual repeats most: a reading that was rounded before its noise came to it
        shows no steps.
        """
        levels = np.diff(np.unique(view.position))
        seen = [float(np.median(levels))] if levels.size else []
        spanned = [view.position_peak / steps for steps in (16, 256, 4096)]
        return [{"step_size": q} for q in [*seen, *spanned, *view.rounding_distances(2)]]

    @classmethod
    def choices(cls, view: RecordView) -> int:
        """Return the number of bins that are compared: every distance of the residual's spectrum over the position."""
        return READING_DISTANCES
