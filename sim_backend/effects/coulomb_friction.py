"""Coulomb friction: a torque of constant size against the direction of motion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim_backend.effects.base import UNLISTED, Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView

_FULL = 0.5
"""Breakaway rate in rms rates at most. At twice the breakaway rate friction is of full size, to 4 %; a sine is faster
than its rms for half of the time. What fades at most rates is not a friction of one size, but a damping of some law."""


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return -p[0] * math.tanh(rate / p[1])


@dataclass(frozen=True)
class CoulombFriction(Effect):
    """Torque -torque · tanh(rate / breakaway_rate): constant in size, smooth below the breakaway rate."""

    name = "coulomb-friction"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "switches sign with the direction of motion and has the same size at any speed"
    step = _step
    beyond: ClassVar = {"breakaway_rate": UNLISTED}

    torque: float = size("friction torque in motion", u=1, low=0.0)
    breakaway_rate: float = shape("rate below which the friction fades", 1e-4, y=1, s=-1, low=1e-12)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return starts of the breakaway rate: 0.1, 1 and 10 % of the peak rate."""
        return [{"breakaway_rate": max(view.rate_peak * part, 1e-12)} for part in (1e-3, 1e-2, 1e-1)]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return breakaway rates below which friction is of one size in half of the motion."""
        return {"breakaway_rate": (1e-12, max(_FULL * float(np.sqrt(np.mean(view.rate**2))), 1e-12))}

    def braking(self) -> float:
        """Return the slope of the torque at rest."""
        return self.torque / self.breakaway_rate
