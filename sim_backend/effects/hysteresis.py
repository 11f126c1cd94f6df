"""Hysteresis, rate-independent: springs in parallel that slip one after the other (Maxwell slip, Iwan)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.presliding_friction import MOST_GIVE
from sim_backend.effects.view import RecordView

_RUNGS = 27.0
"""Ratio of the largest stroke to the smallest."""


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # s[0..3] deflections of the elements, s[4] the last position
    change = position - s[4]
    s[4] = position
    reach = p[4]
    torque = 0.0
    for i in range(4):
        s[i] = min(max(s[i] + change, -reach), reach)
        torque -= p[i] * s[i]
        reach /= 3.0
    return torque


@dataclass(frozen=True)
class Hysteresis(Effect):
    """Torque -sum stiffness_i · z_i: spring i follows the position until its deflection z_i slips at ±reach / 3^(i-1).

    The ladder of strokes is fixed, so that the contribution is linear in all but one number; four elements trace a
    smooth loop over a range of amplitudes of 1 : 27. Every loop is closed, obeys Masing's rule and loses energy.
    Source: W. D. Iwan, J. Appl. Mech. 33 (1966).
    """

    name = "hysteresis"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "is a loop over the position that depends on the last reversals and not on the speed"
    n_state = 5
    step = _step

    stiffness_1: float = size("stiffness of the spring that slips last", u=1, y=-1, low=0.0)
    stiffness_2: float = size("stiffness that slips at a third of the last one's deflection", u=1, y=-1, low=0.0)
    stiffness_3: float = size("stiffness that slips at a ninth of it", u=1, y=-1, low=0.0)
    stiffness_4: float = size("stiffness that slips at a 27th of it", u=1, y=-1, low=0.0)
    reach: float = shape("deflection at which the last spring slips", 1e-3, y=1, low=1e-15)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return strokes in each quarter of the lowest rung.

        A third of a stroke is nearly the same ladder again, and a spring whose stroke exceeds the swing never slips;
        between them a fit has several local minima.
        """
        return [{"reach": max(view.position_peak * part, 1e-15)} for part in (0.57, 0.75, 1.0, 1.3)]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return strokes at which the first spring slips later than friction does."""
        return {"reach": (max(_RUNGS * MOST_GIVE * view.swing, 1e-15), math.inf)}
