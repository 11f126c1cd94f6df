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
    f = p[0] / dt_s
    behind = s[0] - signal
    decayed = -math.expm1(-1.0 / f)
    s[0] -= decayed * behind
    # the loop holds one value per sample: the mean of the exponential over it
    mean = signal + behind * decayed * f
    # held for a sample, the means extend the command more widely in time than the lag does: its second and third
    # moments, 2 f² and 6 f³ samples, are restored by a second and a third difference
    if f < 100.0:
        a = 1.0 - decayed
        second = f * f - 0.5 * f * (1.0 + a) / decayed
        third = (f * (1.0 + 4.0 * a + a * a) / decayed**2 + 6.0 * second * (1.0 + f)) / 6.0 - f**3
    else:  # beyond, f³ cancels digits away; the limits are near by 1e-7 and 6e-5
        second, third = -1.0 / 12.0, -1.0 / 12.0
    bend = mean - 2.0 * s[1] + s[2]
    turn = bend - (s[1] - 2.0 * s[2] + s[3])
    s[1], s[2], s[3] = mean, s[1], s[2]
    return mean + second * bend + third * turn - signal


@dataclass(frozen=True)
class AmplifierLag(Effect):
    """Output of a first-order lag instead of the command; neutral at a time constant of zero.

    Each sample plays what moves a plant as the continuous output y does, with dy/dt = (command - y) / time_constant_s:
    the mean of y over the sample, corrected to third order in the angle per sample.
    """

    name = "amplifier-lag"
    family = "drive"
    site = Site.COMMAND
    symptom = "is proportional to the rate of change of the command"
    linear_form = True
    n_state = 4
    step = _step

    time_constant_s: float = shape("time constant of the amplifier", 0.0, s=1)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return time constants from half a sample to thirty."""
        return [{"time_constant_s": samples / view.rate_hz} for samples in (0.5, 3.0, 30.0)]
