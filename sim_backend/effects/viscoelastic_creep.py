"""Viscoelastic creep: part of the stiffness relaxes in time."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    now = s[0]
    s[0] = now - math.expm1(-dt_s / p[1]) * (position - now)
    return p[0] * now


@dataclass(frozen=True)
class ViscoelasticCreep(Effect):
    """Torque +stiffness · z, with dz/dt = (position - z) / time_constant_s: the standard linear solid.

    The linear model keeps the stiffness against fast motion; held for long, `stiffness` of it is lost.
    """

    name = "viscoelastic-creep"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "creeps on in the direction of the last step and fades over a fixed time"
    linear_form = True
    n_state = 1
    step = _step

    stiffness: float = size("stiffness that relaxes", u=1, y=-1, low=0.0)
    time_constant_s: float = shape("time in which it relaxes", 1.0, s=1, low=1e-9)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return time constants from a thousandth of the record to all of it."""
        return [{"time_constant_s": max(view.duration_s * part, 1e-9)} for part in (1e-3, 1e-2, 0.1, 1.0)]
