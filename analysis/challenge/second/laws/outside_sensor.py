"""Laws of the sensor that are not listed."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from math import sin

from analysis.challenge.second.law import law, log_uniform

_PART = "sensor"


@law("bent-sensor", "unlisted", _PART, lambda s: 0.02 / s.y_rms, how="reading")
def bent_sensor(t, y, v, u, z, p, r, i, j):
    """A sensor with a square in its curve."""
    r[i] += p[0] * y[i] * y[i]


@law("pickup", "unlisted", _PART, lambda s: 0.02 * s.y_rms / s.u_rms, how="reading", cap=20.0)
def pickup(t, y, v, u, z, p, r, i, j):
    """A sensor that picks up the current, more of one sign than of the other."""
    r[i] += p[0] * (u[i] + 0.5 * abs(u[i]))


@law(
    "two-valued-zero",
    "unlisted",
    _PART,
    lambda s: 0.01 * s.y_rms,
    how="reading",
    shapes=lambda rng, s: tuple(log_uniform(rng, 0.02, 0.4) * s.run_s for _ in range(2)),
    cap=20.0,
)
def two_valued_zero(t, y, v, u, z, p, r, i, j):
    """A zero that switches between two values, at times that two incommensurate waves decide."""
    if sin(6.28 * t / p[1]) + sin(6.28 * 1.618 * t / p[2]) > 0.3:
        r[i] += p[0]
