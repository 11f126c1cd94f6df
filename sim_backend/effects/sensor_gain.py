"""Sensor gain: a reading that is a little too large or too small."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return p[0] * signal


@dataclass(frozen=True)
class SensorGain(Effect):
    """Reading · (1 + relative)."""

    name = "sensor-gain"
    family = "sensor"
    site = Site.READING
    exact = True
    linear_form = True
    symptom = "is proportional to the reading, at every frequency and amplitude"
    step = _step

    relative: float = size("relative error of the gain", low=-0.99)
