"""Constant torque: gravity, a cable, or an amplifier's offset pulling all the time."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return p[0]


@dataclass(frozen=True)
class ConstantTorque(Effect):
    """A torque that never changes."""

    name = "constant-torque"
    family = "surroundings"
    site = Site.STRUCTURE
    exact = True
    symptom = "is an offset that settles to a constant whatever is played"
    step = _step

    torque: float = size("the constant torque", u=1)
