"""Coil heating: the drive weakens while it works."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    heat = s[0]
    s[0] = heat - math.expm1(-dt_s / p[1]) * (signal * signal - heat)
    return -p[0] * heat * signal


@dataclass(frozen=True)
class CoilHeating(Effect):
    """Command · (1 - coefficient · heat), with d heat/dt = (command² - heat) / time_constant_s."""

    name = "coil-heating"
    family = "drive"
    site = Site.COMMAND
    symptom = "is a loss of gain that builds up and fades with the square of the command"
    n_state = 1
    step = _step

    coefficient: float = size("relative loss of gain per mean square command", u=-2)
    time_constant_s: float = shape("time in which the coil warms and cools", 10.0, s=1, low=1e-9)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return time constants from a hundredth of the record to all of it."""
        return [{"time_constant_s": max(view.duration_s * part, 1e-9)} for part in (0.01, 0.1, 1.0)]
