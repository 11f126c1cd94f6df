"""Command quantisation: the drive plays only whole steps."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # beyond 2^52 steps every float is a whole number of them, within its rounding
    if abs(signal) >= p[0] * 4503599627370496.0:
        return 0.0
    return p[0] * math.floor(signal / p[0] + 0.5) - signal


@dataclass(frozen=True)
class CommandQuantisation(Effect):
    """The command rounded to whole steps; neutral at a step of zero."""

    name = "command-quantisation"
    family = "drive"
    site = Site.COMMAND
    symptom = "is a sawtooth over the command, bounded however large it is"
    step = _step
    whole = True

    step_size: float = shape("smallest change of the output", 0.0, u=1)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the steps that the residual speaks for, or from a 4096th of the largest command to a quarter of it."""
        steps = view.likely_roundings(4) or [view.u_peak / parts for parts in (4, 32, 256, 4096)]
        return [{"step_size": q} for q in steps]

    @classmethod
    def choices(cls, view: RecordView) -> float:
        """Return among how many steps these were found."""
        return view.rounding_choices()
