"""Any torque that depends on command, position and rate at once: an unlisted cause in general terms.

Not part of the library, because it is not a cause: a diagnosis compares what it found with a few of its terms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, constant, size
from sim_backend.effects.compiled import compiled
from sim_backend.effects.view import RecordView


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    u, x, v = signal / p[20], position / p[21], rate / p[22]
    ax, av, au = abs(x), abs(v), abs(u)
    even = p[0] * x * x + p[1] * x * v + p[2] * v * v + p[3] * ax * v
    odd = x * (p[4] * ax + p[5] * x * x + p[6] * x * x * x * x) + v * (p[7] * av + p[8] * v * v)
    crossed = x * v * (p[9] * x + p[10] * v)
    driven = u * (p[11] * u + p[12] * au + p[13] * u * u + p[14] * u * u * u * u)
    both = u * (p[15] * x + p[16] * x * x + p[17] * v)
    return even + odd + crossed + driven + both + p[18] * math.tanh(20.0 * v) + p[19] * math.tanh(20.0 * u)


@dataclass(frozen=True)
class UnlistedTorque(Effect):
    """A weighted sum of twenty products and functions of u, x and v, which are command, position and rate by swing."""

    name = "unlisted-torque"
    family = "structure"
    site = Site.STRUCTURE
    symptom = "depends on command, position and rate in a way that no listed cause does"
    step = _step

    xx: float = size("torque by x²", u=1)
    xv: float = size("torque by x v", u=1)
    vv: float = size("torque by v²", u=1)
    xv_even: float = size("torque by |x| v", u=1)
    xx_odd: float = size("torque by x |x|", u=1)
    xxx: float = size("torque by x³", u=1)
    xxxxx: float = size("torque by x⁵", u=1)
    vv_odd: float = size("torque by v |v|", u=1)
    vvv: float = size("torque by v³", u=1)
    xxv: float = size("torque by x² v", u=1)
    xvv: float = size("torque by x v²", u=1)
    uu: float = size("torque by u²", u=1)
    uu_odd: float = size("torque by u |u|", u=1)
    uuu: float = size("torque by u³", u=1)
    uuuuu: float = size("torque by u⁵", u=1)
    ux: float = size("torque by u x", u=1)
    uxx: float = size("torque by u x²", u=1)
    uv: float = size("torque by u v", u=1)
    v_sign: float = size("torque by tanh 20 v", u=1)
    u_sign: float = size("torque by tanh 20 u", u=1)
    command_swing: float = constant("unit of the command", 1.0, u=1, low=1e-300)
    position_swing: float = constant("unit of the position", 1.0, y=1, low=1e-300)
    rate_swing: float = constant("unit of the rate", 1.0, y=1, s=-1, low=1e-300)

    @classmethod
    def guess(cls, view: RecordView) -> list[dict[str, float]]:
        """Return the swings of command and motion as units."""
        swings = {"command_swing": view.u_peak, "position_swing": view.position_peak, "rate_swing": view.rate_peak}
        return [{name: max(value, 1e-300) for name, value in swings.items()}]
