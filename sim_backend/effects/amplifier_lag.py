"""Amplifier lag: the output follows the command with the time constant of the current loop."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    if p[0] <= 0.0:
        return 0.0
    behind = s[0] - signal
    decayed = -math.expm1(-dt_s / p[0])
    s[0] -= decayed * behind
    # the loop holds one value per sample: the mean of the exponential over it
    return behind * decayed * (p[0] / dt_s)


@dataclass(frozen=True)
class AmplifierLag(Effect):
    """Output of a first-order lag instead of the command; neutral at a time constant of zero.

    Each sample plays the mean of the continuous output y over it, with dy/dt = (command - y) / time_constant_s: second
    order accurate in the sample time.
    """

    name = "amplifier-lag"
    family = "drive"
    site = Site.COMMAND
    symptom = "is proportional to the rate of change of the command"
    n_state = 1
    step = _step

    time_constant_s: float = shape("time constant of the amplifier", 0.0, s=1)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return time constants from half a sample to thirty."""
        return [{"time_constant_s": samples / view.rate_hz} for samples in (0.5, 3.0, 30.0)]
