"""Dead zone: small commands are ignored."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return -min(max(signal, -p[0]), p[0])


@dataclass(frozen=True)
class DeadZone(Effect):
    """Zero within ±width, the command less the width beyond; neutral at zero width."""

    name = "dead-zone"
    family = "drive"
    site = Site.COMMAND
    symptom = "switches sign with the command, has the same size at any larger command and follows it near zero"
    step = _step

    width: float = shape("largest command that is ignored", 0.0, u=1)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return widths from a small to a large part of the largest command."""
        return [{"width": view.u_peak * part} for part in (0.01, 0.1, 0.4)]
