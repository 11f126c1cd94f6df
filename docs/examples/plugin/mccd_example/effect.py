"""A spring whose force has a part in the square of the deflection: a magnet beside the middle, say."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return -p[0] * position * position


@dataclass(frozen=True)
class QuadraticStiffness(Effect):
    """Torque -stiffness · position²."""

    name = "quadratic-stiffness"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "grows with the square of the deflection, to the same side for both signs of it"
    step = _step

    stiffness: float = size("quadratic coefficient of the restoring torque", u=1, y=-2)
