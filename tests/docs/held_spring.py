"""How far the spring of a simulation that takes steps is off, which no standard deviation of noise counts."""

from __future__ import annotations

import math


def relative_error(frequency_hz: float, step_s: float, stiffening: float = 0.0) -> float:
    """Return by how much a torque along the motion acts too strongly, to second order in the step.

    The kernel extrapolates a torque M(t) to the middle of a step from its last two values, M + (M - M_before) / 2, and
    holds it. Against M(t + T/2) that is -3/8 T² M'' too much, and holding passes on 1 - (ω T)² / 24 of it. At ω, where
    M'' = -ω² M, that leaves (3/8 - 1/24) (ω T)² = (ω T)² / 3. `stiffening` is the relative rise of the stiffness at the
    largest deflection, by which ω² rises.
    """
    return (1.0 + stiffening) * (2.0 * math.pi * frequency_hz * step_s) ** 2 / 3.0
