"""Periodic sensor error: an interferometer or encoder errs within each period of its scale."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.over_position import READING_DISTANCES
from sim_backend.effects.periodic import Periodic
from sim_backend.effects.view import RecordView


@dataclass(frozen=True)
class PeriodicSensorError(Periodic, Effect):
    """Reading plus cosine · cos(2π position / period) + sine · sin(2π position / period)."""

    name = "periodic-sensor-error"
    family = "sensor"
    site = Site.READING
    symptom = "repeats at even distances of the position, as strongly in fast motion as in slow"

    cosine: float = size("error in phase with the centre", y=1)
    sine: float = size("error a quarter period off the centre", y=1)
    period: float = shape("distance after which it repeats", 1e-3, y=1, low=1e-12)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the distances at which the residual repeats most."""
        return [{"period": max(distance, 1e-12)} for distance in view.residual_periods(4)]

    @classmethod
    def choices(cls, view: RecordView) -> int:
        """Return the number of bins that are compared: every distance of the residual's spectrum over the position."""
        return READING_DISTANCES
