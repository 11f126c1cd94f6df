"""Amplifier saturation: the command beyond a limit is cut off."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return min(max(signal, -p[0]), p[0]) - signal


@dataclass(frozen=True)
class AmplifierSaturation(Effect):
    """The output stays within ±limit; neutral at an infinite limit. At an actuator the limit is a current (A)."""

    name = "amplifier-saturation"
    family = "drive"
    site = Site.COMMAND
    symptom = "appears only while the command is beyond a fixed level"
    step = _step

    limit: float = shape("largest magnitude that the amplifier gives", math.inf, u=1, low=0.0, spread=0.4)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return limits below the largest command of the record, by what they cut off: a 500th to half of it."""
        return [{"limit": view.u_peak * (1.0 - 0.5 / 3.0**k)} for k in range(6)]
