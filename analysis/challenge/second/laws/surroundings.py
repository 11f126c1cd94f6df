"""Listed laws of the surroundings: torques that come whatever is played."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from math import sin

from analysis.challenge.second.law import law, log_uniform

_PART = "surroundings"


@law(
    "hum",
    "listed",
    _PART,
    lambda s: 0.05 * s.u_rms,
    effect="vibration-line",
    shapes=lambda rng, s: (6.28 * s.frequency_hz * log_uniform(rng, 0.4, 3.0), rng.uniform(0.0, 6.28)),
)
def hum(t, y, v, u, z, dz, p, f, i, j):
    """A vibration line."""
    f[i] += p[0] * sin(p[1] * t + p[2])


@law("weight", "listed", _PART, lambda s: 0.05 * s.u_rms, effect="constant-torque", parameter="torque", springy=True)
def weight(t, y, v, u, z, dz, p, f, i, j):
    """A torque that is always there."""
    f[i] += p[0]


@law(
    "warm-spring",
    "listed",
    _PART,
    lambda s: 0.05 * s.stiffness / s.kelvin,
    effect="thermal-stiffness-drift",
    shapes=lambda rng, s: (s.kelvin, 6.283185307179586 * s.kelvin_hz),
    springy=True,
    parameter="coefficient",
)
def warm_spring(t, y, v, u, z, dz, p, f, i, j):
    """A stiffness that follows the temperature."""
    f[i] -= p[0] * p[1] * sin(p[2] * t) * y[i]
