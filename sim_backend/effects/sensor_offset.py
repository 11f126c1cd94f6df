"""Sensor offset: the zero of the reading is arbitrary, as on a bench that counts from wherever it was switched on."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return p[0]


@dataclass(frozen=True)
class SensorOffset(Effect):
    """Reading plus a constant. An identification writes it, so that a foreign bench's zero is not taken for physics."""

    name = "sensor-offset"
    family = "sensor"
    site = Site.READING
    symptom = "is the same at all times, whatever is played"
    step = _step

    offset: float = size("reading at the operating point", y=1)
