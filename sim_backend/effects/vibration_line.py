"""Vibration line: a pump or the mains shakes the bench at one frequency."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    # s[0] is the phase in periods, kept within one so that it stays exact in long runs
    angle = 6.283185307179586 * s[0]
    s[0] = (s[0] + p[2] * dt_s) % 1.0
    return p[0] * math.cos(angle) + p[1] * math.sin(angle)


_PERIODS = 20.0


@dataclass(frozen=True)
class VibrationLine(Effect):
    """Torque cosine · cos(2π frequency_hz t) + sine · sin(2π frequency_hz t), t from the start of the run."""

    name = "vibration-line"
    family = "surroundings"
    site = Site.STRUCTURE
    symptom = "is a line at a fixed frequency, whatever is played"
    n_state = 1
    step = _step

    cosine: float = size("torque in phase with the start", u=1)
    sine: float = size("torque a quarter period later", u=1)
    frequency_hz: float = shape("frequency of the vibration", 50.0, s=-1, low=1e-9)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the strongest lines of the residual."""
        # fewer periods than this are drift: the noise down there is known from a handful of rows
        return [{"frequency_hz": f} for f in view.residual_lines_hz(5) if f * view.duration_s > _PERIODS]

    @classmethod
    def choices(cls, view: RecordView) -> int:
        """Return the number of lines that are compared: every frequency of the residual's spectrum."""
        return view.residual.size // 2
