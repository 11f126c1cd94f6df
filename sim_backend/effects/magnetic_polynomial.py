"""Magnetic polynomial: the torque by which the actuators' magnets add to the springs, Fig. 6.8 of the paper."""

from __future__ import annotations

from dataclasses import dataclass

from sim_backend.effects.base import Effect, Site, size
from sim_backend.effects.compiled import compiled


@compiled
def _step(signal, position, rate, aux, dt_s, p, s):  # type: ignore[no-untyped-def]
    return ((((p[0] * position + p[1]) * position + p[2]) * position + p[3]) * position + p[4]) * position + p[5]


@dataclass(frozen=True)
class MagneticPolynomial(Effect):
    """Torque p1 x⁵ + p2 x⁴ + p3 x³ + p4 x² + p5 x + p6 of the position x, added to the drive.

    In SI units: the paper prints the coefficients for x in mrad, so its p1 is 1e15 times smaller than this one, p2
    1e12 times, …, p5 1e3 times. It attributes them to the position-dependent force constant.
    """

    name = "magnetic-polynomial"
    family = "structure"
    site = Site.STRUCTURE
    cause = "position-dependent-force-constant"
    symptom = "is a smooth curve over the position, the same in both directions and at any speed"
    step = _step

    p1: float = size("coefficient of position⁵", u=1, y=-5)
    p2: float = size("coefficient of position⁴", u=1, y=-4)
    p3: float = size("coefficient of position³", u=1, y=-3)
    p4: float = size("coefficient of position²", u=1, y=-2)
    p5: float = size("coefficient of position", u=1, y=-1)
    p6: float = size("constant part", u=1)
