"""End-stop contact: a stiff, lossy stop is touched beyond the travel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    depth = abs(position) - p[2]
    if depth <= 0.0:
        return 0.0
    push = p[0] * depth if position > 0.0 else -p[0] * depth
    return -push - p[1] * depth * rate


@dataclass(frozen=True)
class EndStopContact(Effect):
    """Torque -(stiffness · depth · sign(position) + damping · depth · rate) at a depth |position| - gap > 0.

    The damping grows with the depth, so that the torque has no jump at the touch. Source: K. H. Hunt and F. R. E.
    Crossley, J. Appl. Mech. 42 (1975), with exponent 1.
    """

    name = "end-stop-contact"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "appears suddenly beyond a fixed deflection and pushes back"
    step = _step
    beyond: ClassVar = {"gap": "backlash"}

    stiffness: float = size("stiffness of the stop", u=1, y=-1, low=0.0)
    damping: float = size("damping of the stop per depth", u=1, y=-2, s=1, low=0.0)
    gap: float = shape("travel to either side until the touch", 0.01, y=1, spread=0.4)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return gaps just inside the largest deflection of the record."""
        return [{"gap": view.position_peak * part} for part in (0.98, 0.9, 0.75, 0.5)]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return gaps of half the largest deflection and more: what lets an axis go twice as far stops nothing."""
        return {"gap": (0.5 * view.position_peak, math.inf)}
