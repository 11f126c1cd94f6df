"""Cubic stiffness: a spring that hardens or softens with the cube of its deflection."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return -p[0] * position * position * position


@dataclass(frozen=True)
class CubicStiffness(Effect):
    """Torque -stiffness · position³; positive hardens, negative softens."""

    name = "cubic-stiffness"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "grows with the cube of the deflection, at any frequency, and is odd in it"
    step = _step

    stiffness: float = size("cubic coefficient of the restoring torque", u=1, y=-3)
