"""Periodic torque (cogging): magnets or teeth pull towards evenly spaced positions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from sim_backend.effects.base import UNLISTED, Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import DISTANCES, RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    angle = 6.283185307179586 * (position / p[2])
    return p[0] * math.cos(angle) + p[1] * math.sin(angle)


@dataclass(frozen=True)
class PeriodicTorque(Effect):
    """Torque cosine · cos(2π position / period) + sine · sin(2π position / period)."""

    name = "periodic-torque"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "repeats at even distances of the position, the same in both directions, filtered by the plant"
    beyond: ClassVar = {"period": UNLISTED}
    step = _step

    cosine: float = size("torque in phase with the centre", u=1)
    sine: float = size("torque a quarter period off the centre", u=1)
    period: float = shape("distance after which it repeats", 1e-3, y=1, low=1e-12)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the distances at which a force is most likely to repeat, or else those at which the residual does."""
        distances = view.force_periods(4) or view.residual_periods(4)
        return [{"period": max(distance, 1e-12)} for distance in distances]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return the distance within which the position mostly is: what seldom comes again is not seen to repeat."""
        return {"period": (1e-12, max(view.position_spread, 1e-12))}

    @classmethod
    def choices(cls, view: RecordView) -> int:
        """Return the number of bins that are compared: every distance of the residual's spectrum over the position."""
        return DISTANCES
