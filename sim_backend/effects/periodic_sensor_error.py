"""Periodic sensor error: an interferometer or encoder errs within each period of its scale."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from sim_backend.effects.base import UNLISTED, Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import READING_DISTANCES, RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    angle = 6.283185307179586 * (position / p[2])
    return p[0] * math.cos(angle) + p[1] * math.sin(angle)


@dataclass(frozen=True)
class PeriodicSensorError(Effect):
    """Reading plus cosine · cos(2π position / period) + sine · sin(2π position / period)."""

    name = "periodic-sensor-error"
    family = "sensor"
    site = Site.READING
    symptom = "repeats at even distances of the position, as strongly in fast motion as in slow"
    beyond: ClassVar = {"period": UNLISTED}
    step = _step

    cosine: float = size("error in phase with the centre", y=1)
    sine: float = size("error a quarter period off the centre", y=1)
    period: float = shape("distance after which it repeats", 1e-3, y=1, low=1e-12)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the distances at which the residual repeats most."""
        return [{"period": max(distance, 1e-12)} for distance in view.residual_periods(4)]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return the distance within which the position mostly is: what seldom comes again is not seen to repeat."""
        return {"period": (1e-12, max(view.position_spread, 1e-12))}

    @classmethod
    def choices(cls, view: RecordView) -> int:
        """Return the number of bins that are compared: every distance of the residual's spectrum over the position."""
        return READING_DISTANCES
