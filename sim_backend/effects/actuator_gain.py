"""Actuator gain: the drive gives a little more or less than it is asked for."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return p[0] * signal


@dataclass(frozen=True)
class ActuatorGain(Effect):
    """Command · (1 + relative); at an actuator it is that one's current."""

    name = "actuator-gain"
    family = "drive"
    site = Site.COMMAND
    exact = True
    linear_form = True
    symptom = "is proportional to the response to the command, at every frequency and amplitude"
    step = _step

    relative: float = size("relative error of the gain", low=-0.99)
