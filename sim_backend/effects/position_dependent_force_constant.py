"""Position-dependent force constant: the same current gives another torque away from the centre."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return signal * position * (p[0] + p[1] * position)


@dataclass(frozen=True)
class PositionDependentForceConstant(Effect):
    """Torque · (1 + linear · position + quadratic · position²)."""

    name = "position-dependent-force-constant"
    family = "drive"
    site = Site.DRIVE
    symptom = "grows with the product of the command and a power of the deflection"
    step = _step

    linear: float = size("relative change of the force constant per position", y=-1)
    quadratic: float = size("relative change of the force constant per position²", y=-2)
