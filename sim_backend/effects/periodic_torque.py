"""Periodic torque (cogging): magnets or teeth pull towards evenly spaced positions."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.periodic import Periodic
from sim_backend.effects.view import DISTANCES, RecordView


@dataclass(frozen=True)
class PeriodicTorque(Periodic, Effect):
    """Torque cosine · cos(2π position / period) + sine · sin(2π position / period)."""

    name = "periodic-torque"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "repeats at even distances of the position, the same in both directions, filtered by the plant"

    cosine: float = size("torque in phase with the centre", u=1)
    sine: float = size("torque a quarter period off the centre", u=1)
    period: float = shape("distance after which it repeats", 1e-3, y=1, low=1e-12)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the distances at which a force is most likely to repeat, or else those at which the residual does."""
        distances = view.force_periods(4) or view.residual_periods(4)
        return [{"period": max(distance, 1e-12)} for distance in distances]

    @classmethod
    def choices(cls, view: RecordView) -> int:
        """Return the number of bins that are compared: every distance of the residual's spectrum over the position."""
        return DISTANCES
