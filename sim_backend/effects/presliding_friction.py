"""Dry friction that gives a little before it slips: bristles, or rubber that rolls."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView

MOST_GIVE = 0.02
"""Part of the swing within which friction has reversed; what takes longer is called hysteresis."""


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # s[0] is the torque in units of that in sliding, s[1] the last position; exact over any step in one direction
    change = position - s[1]
    s[1] = position
    if change != 0.0:
        end = 1.0 if change > 0.0 else -1.0
        s[0] = end + (s[0] - end) * math.exp(-abs(change) / p[1])
    return -p[0] * s[0]


@dataclass(frozen=True)
class PreslidingFriction(Effect):
    """Torque -torque · f with df/dx = (1 - f sign(dx)) / give: it turns with the direction, over a path of some `give`.

    The same torque with a give of the size of the swing would be called hysteresis; what is believed of the give
    before the data speak is that it is a small part of the swing.
    Source: P. R. Dahl, AIAA Journal 14 (1976), with exponent 1.
    """

    name = "presliding-friction"
    family = "structure"
    site = Site.STRUCTURE
    cause = "coulomb-friction"
    symptom = "switches sign soon after the motion turns and has the same size at any speed"
    n_state = 2
    step = _step
    beyond: ClassVar = {"give": "hysteresis"}

    torque: float = size("friction torque in sliding", u=1, low=0.0)
    give: float = shape("path over which it turns", 1e-6, y=1, low=1e-15, spread=1.0)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return gives around a 500th of the largest deflection."""
        return [{"give": max(view.position_peak * part, 1e-15)} for part in (0.5e-3, 2e-3, 8e-3)]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return gives that are a small part of the motion: beyond them what turns is a loop."""
        return {"give": (1e-15, max(MOST_GIVE * view.swing, 1e-15))}
