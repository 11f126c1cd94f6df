"""Slow softening: a stiffness falls with how strongly its part has moved lately, and costs no damping."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sim_backend.effects.base import Effect, Site, constant, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # s[0] mean square of the deflection, s[1] time it is known for: what was before is taken to be like what is
    s[1] += dt_s
    span = min(s[1], p[2])
    s[0] += (dt_s / span if span > dt_s else 1.0) * (position * position - s[0])
    return p[0] * position * math.sqrt(s[0]) / p[1]


@dataclass(frozen=True)
class SlowSoftening(Effect):
    """Torque +softening · x · r / level, r² being the mean square of x over the time `memory` (first order).

    The fall of a modulus with the amplitude of vibration that ceramics and joints show, in first order in the
    amplitude: it follows the level of the motion, not the motion itself, so that a sine stays a sine and hardly any
    energy is lost. A spring that depends on the deflection of the moment distorts what it detunes.
    Source: J. A. TenCate and T. J. Shankland, Geophysical Research Letters 23 (1996); R. A. Guyer and P. A. Johnson,
    Physics Today 52 (1999).
    """

    name = "slow-softening"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "is that of a mode that gets softer the more it moves, and is damped no more than before"
    n_state = 2
    step = _step

    softening: float = size("stiffness lost at the level", u=1, y=-1, low=0.0)
    level: float = constant("rms deflection at which so much is lost", 1e-3, y=1, low=1e-15)
    memory: float = shape("time over which the deflection is averaged", 1.0, s=1, low=1e-6)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the level of the record."""
        return [{"level": max(float(np.sqrt(np.mean(view.position**2))), 1e-15)}]
