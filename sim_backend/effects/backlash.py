"""Backlash: the spring has free play around the centre."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return p[0] * min(max(position, -p[1]), p[1])


@dataclass(frozen=True)
class Backlash(Effect):
    """Torque +stiffness · position within ±gap and +stiffness · gap beyond: a spring that is loose within its play.

    With `stiffness` that of the linear model nothing at all holds the axis within the gap. Free play stores no
    energy, so it has no direction of motion in it.
    """

    name = "backlash"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "switches sign at the centre, has the same size at any larger deflection and no loop"
    step = _step
    beyond: ClassVar = {"gap": "end-stop-contact"}

    stiffness: float = size("stiffness that is missing within the play", u=1, y=-1, low=0.0)
    gap: float = shape("free play to either side", 1e-4, y=1)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return gaps from a small to a large part of the swing."""
        return [{"gap": view.position_peak * part} for part in (0.01, 0.05, 0.2, 0.5)]

    @classmethod
    def limits(cls, view: RecordView) -> dict[str, tuple[float, float]]:
        """Return gaps up to half the largest deflection: what mostly is loose has a stop at either end, and no play."""
        return {"gap": (0.0, 0.5 * view.position_peak)}
