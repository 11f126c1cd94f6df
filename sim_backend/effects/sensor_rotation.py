"""Sensor rotation: the sensors' axes are rotated relative to those of the motion."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Aux, Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return p[0] * aux


@dataclass(frozen=True)
class SensorRotation(Effect):
    """Reading of the target plus angle · position of the source; `where` is "source->target"."""

    name = "sensor-rotation"
    family = "sensor"
    site = Site.READING
    exact = True
    linear_form = True
    symptom = "follows the motion of another axis, in proportion and without delay"
    aux = Aux.SOURCE_POSITION
    step = _step

    angle: float = size("share of the source's motion that the target sees; for small angles the angle in rad")
