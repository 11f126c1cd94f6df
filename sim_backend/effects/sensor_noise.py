"""Sensor noise: white within the sample rate, at a sensor head or a reading."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Aux, Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return p[0] * aux


@dataclass(frozen=True)
class SensorNoise(Effect):
    """Gaussian noise of standard deviation `std` per sample."""

    name = "sensor-noise"
    family = "sensor"
    site = Site.READING
    symptom = "is random, the same at every frequency and position"
    aux = Aux.EXOGENOUS
    step = _step

    std: float = size("standard deviation per sample", y=1, low=0.0)
