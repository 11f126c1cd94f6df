"""Sensor drift: the zero of the reading moves with time."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    elapsed = s[0]
    s[0] += dt_s
    return p[0] * elapsed


@dataclass(frozen=True)
class SensorDrift(Effect):
    """Reading plus drift · time since the start; an offset at the start is the zero of the reading."""

    name = "sensor-drift"
    family = "sensor"
    site = Site.READING
    symptom = "grows steadily with time, whatever is played"
    n_state = 1
    step = _step

    drift: float = size("change of the zero per second", y=1, s=-1)
