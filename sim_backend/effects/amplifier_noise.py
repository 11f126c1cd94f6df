"""Amplifier noise: random, white or of a given bandwidth, at an actuator's current or an input's command."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Aux, Effect, Site, shape, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # first-order low pass of unit variance: y += part (x - y) has variance part / (2 - part) of that of x; s[0] is y.
    # part and gain cost more than all the rest: s[2] and s[3] keep them for the bandwidth times dt_s in s[1]
    corner = p[1] * dt_s
    if s[1] != corner:
        part = -math.expm1(-2.0 * math.pi * corner)
        s[1], s[2], s[3] = corner, part, math.sqrt((2.0 - part) / part)
    s[0] += s[2] * (aux - s[0])
    return p[0] * s[3] * s[0]


@dataclass(frozen=True)
class AmplifierNoise(Effect):
    """Gaussian noise of standard deviation `std`, through a first-order low pass; white without `bandwidth_hz`."""

    name = "amplifier-noise"
    family = "drive"
    site = Site.COMMAND
    symptom = "is random and has the shape of the plant's response"
    aux = Aux.EXOGENOUS
    n_state = 4
    step = _step

    std: float = size("standard deviation", u=1, low=0.0)
    bandwidth_hz: float = shape("corner frequency of the noise", math.inf, s=-1, low=1e-3)
