"""Any smooth force of position and rate, and one that turns with the rate: what no listed cause is, in general terms.

Not part of the library, because it is not a cause: a diagnosis holds what it found against it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, shape, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    x, v = position / p[8], rate / p[9]
    smooth = x * x * (p[0] + p[1] * x + p[2] * x * x * x) + v * (p[3] * abs(v) + p[4] * v * v + p[5] * x * x)
    return -(smooth + p[6] * x * v * v + p[7] * math.tanh(20.0 * v))


@dataclass(frozen=True)
class UnlistedForce(Effect):
    """Torque -(a x² + b x³ + c x⁵ + d v|v| + e v³ + f x²v + g xv² + h tanh 20v), x and v relative to their swing."""

    name = "unlisted-force"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "depends on position and rate in a way that no listed cause does"
    step = _step

    square: float = size("torque at full position, even", u=1)
    cube: float = size("torque at full position, odd", u=1)
    fifth: float = size("torque at full position, fifth power", u=1)
    drag: float = size("torque at full rate, square", u=1)
    rate_cube: float = size("torque at full rate, cube", u=1)
    damped: float = size("damping that grows with the deflection", u=1)
    spun: float = size("stiffness that grows with the rate", u=1)
    dry: float = size("torque against the rate at any rate", u=1)
    position_swing: float = shape("unit of the position", 1.0, y=1, low=1e-300, spread=0.1)
    rate_swing: float = shape("unit of the rate", 1.0, y=1, s=-1, low=1e-300, spread=0.1)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the swings of the motion as units."""
        return [
            {
                "position_swing": max(view.position_peak, 1e-300),
                "rate_swing": max(float(abs(view.rate).max(initial=0.0)), 1e-300),
            }
        ]
