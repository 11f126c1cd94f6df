"""Amplifier saturation that sets in softly: the output approaches a limit asymptotically."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    if p[0] <= 0.0:  # nothing passes
        return -signal
    size = abs(signal) / p[0]
    if size < 1e-9:  # so small a part of the limit bends by nothing, and most commands are none: spares three powers
        return 0.0
    # the larger of size and one is taken out, so that no power overflows
    larger = max(size, 1.0)
    bent = larger * ((size / larger) ** p[1] + (1.0 / larger) ** p[1]) ** (1.0 / p[1])
    return signal * (1.0 / bent - 1.0)


@dataclass(frozen=True)
class SoftSaturation(Effect):
    """Output u / (1 + |u/limit|^sharpness)^(1/sharpness): slope one at rest, ±limit in the end; neutral at infinity.

    A sharpness of 2.5 is close to limit · tanh(u/limit), a high one to a hard limit. At an actuator the limit is a
    current (A). Source: C. Rapp, Proc. 2nd European Conf. Satellite Communications (1991), for amplifiers.
    """

    name = "soft-saturation"
    family = "drive"
    site = Site.COMMAND
    cause = "amplifier-saturation"
    symptom = "grows as the command comes near a level that it cannot pass"
    step = _step

    limit: float = shape("what the output tends to", math.inf, u=1, low=0.0, spread=0.7)
    sharpness: float = shape("how suddenly it bends", 2.0, low=1.0, high=20.0, spread=0.5)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return limits from half of the largest command to four times it, bending gently and less so."""
        return [{"limit": view.u_peak * part, "sharpness": n} for n in (2.0, 4.0) for part in (0.5, 1.0, 2.0, 4.0)]
