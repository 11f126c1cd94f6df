"""Sensor quantisation: the reading comes in whole steps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim_backend.effects.base import Effect, Site, shape
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import READING_DISTANCES, RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # beyond 2^52 steps every float is a whole number of them, within its rounding
    if abs(signal) >= p[0] * 4503599627370496.0:
        return 0.0
    return p[0] * math.floor(signal / p[0] + 0.5) - signal


@dataclass(frozen=True)
class SensorQuantisation(Effect):
    """The reading rounded to whole steps; neutral at a step of zero."""

    name = "sensor-quantisation"
    family = "sensor"
    site = Site.READING
    symptom = "is a sawtooth over the reading, bounded however far it moves"
    step = _step
    whole = True

    step_size: float = shape("smallest change of the reading", 0.0, y=1)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the usual distance between neighbouring values of the position, steps that span the swing, and others.

        These are the distances at which the residual repeats most: a reading that was rounded before its noise came to
        it shows no steps.
        """
        levels = np.diff(np.unique(view.position))
        seen = [float(np.median(levels))] if levels.size else []
        spanned = [view.position_peak / steps for steps in (16, 256, 4096)]
        return [{"step_size": q} for q in [*seen, *spanned, *view.residual_periods(2)]]

    @classmethod
    def choices(cls, view: RecordView) -> int:
        """Return the number of bins that are compared: every distance of the residual's spectrum over the position."""
        return READING_DISTANCES
