"""Apex noise: an interferometer reads noisier as its beam nears the apex of the retro-reflector."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Aux, Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return aux * (p[0] * abs(position) + p[1] * position * position)


@dataclass(frozen=True)
class ApexNoise(Effect):
    """White noise of standard deviation linear · |position| + quadratic · position² per sample, none at the centre."""

    name = "apex-noise"
    family = "sensor"
    site = Site.READING
    symptom = "is random and grows with the distance from the centre"
    aux = Aux.EXOGENOUS
    step = _step

    linear: float = size("standard deviation per distance from the centre", low=0.0)
    quadratic: float = size("standard deviation per square of the distance from the centre", y=-1, low=0.0)
