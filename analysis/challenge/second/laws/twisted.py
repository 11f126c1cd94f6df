"""Listed laws with a twist: the name is right, and something remains that it does not explain."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from math import copysign, exp, sin, sqrt, tanh

from analysis.challenge.second.law import law, log_uniform

_PART = "structure"


@law(
    "asymmetric-coulomb",
    "twisted",
    _PART,
    lambda s: 0.1 * s.u_rms,
    effect="coulomb-friction",
    shapes=lambda rng, s: (s.v_rms * log_uniform(rng, 2e-3, 2e-2), rng.uniform(0.2, 0.6)),
    rate=lambda p, s: 1.5 * p[0] / (p[1] * s.inertia),
)
def asymmetric_coulomb(t, y, v, u, z, dz, p, f, i, j):
    """Friction that is larger in one direction than in the other."""
    f[i] -= p[0] * tanh(v[i] / p[1]) * (1.0 + p[2] * (0.5 + 0.5 * tanh(v[i] / p[1])))


@law(
    "stribeck-friction",
    "twisted",
    _PART,
    lambda s: 0.1 * s.u_rms,
    effect="coulomb-friction",
    shapes=lambda rng, s: (s.v_rms * log_uniform(rng, 2e-3, 2e-2), rng.uniform(0.3, 1.0), s.v_rms * 0.2),
    rate=lambda p, s: 2.0 * p[0] / (p[1] * s.inertia),
)
def stribeck_friction(t, y, v, u, z, dz, p, f, i, j):
    """Friction that falls from its size at rest as the motion grows faster (R. Stribeck, 1902)."""
    f[i] -= p[0] * tanh(v[i] / p[1]) * (1.0 + p[2] * exp(-((v[i] / p[3]) ** 2)))


@law(
    "hardening-loop",
    "twisted",
    _PART,
    lambda s: 0.1 * s.u_rms,
    effect="hysteresis",
    states=1,
    shapes=lambda rng, s: (s.y_peak * log_uniform(rng, 0.08, 0.4), rng.uniform(0.5, 1.5) / s.y_peak**2),
    rate=lambda p, s: s.v_peak / p[1],
)
def hardening_loop(t, y, v, u, z, dz, p, f, i, j):
    """A loop that opens with the square of the deflection."""
    dz[0] = (v[i] - abs(v[i]) * z[0]) / p[1]
    f[i] -= p[0] * z[0] * (1.0 + p[2] * y[i] * y[i])


@law(
    "lopsided-cubic",
    "twisted",
    _PART,
    lambda s: 0.1 * s.slope / s.y_rms**2,
    effect="cubic-stiffness",
    shapes=lambda rng, s: (s.y_rms * rng.uniform(0.3, 0.8),),
    springy=True,
)
def lopsided_cubic(t, y, v, u, z, dz, p, f, i, j):
    """A cubic spring whose centre is offset, which adds a quadratic term."""
    f[i] -= p[0] * ((y[i] + p[1]) ** 3 - p[1] ** 3 - 3.0 * p[1] * p[1] * y[i])


@law(
    "one-sided-stop",
    "twisted",
    _PART,
    lambda s: s.slope,
    effect="end-stop-contact",
    shapes=lambda rng, s: (s.y_peak * rng.uniform(0.5, 0.8), rng.uniform(0.1, 0.5)),
    rate=lambda p, s: float(sqrt(p[0] / s.inertia)),
)
def one_sided_stop(t, y, v, u, z, dz, p, f, i, j):
    """Stops of which one is softer than the other."""
    depth = abs(y[i]) - p[1]
    if depth > 0.0:
        f[i] -= p[0] * copysign(depth, y[i]) * (1.0 if y[i] > 0.0 else p[2])


@law(
    "lopsided-dead-zone",
    "twisted",
    "drive",
    lambda s: 0.05 * s.u_rms,
    effect="dead-zone",
    shapes=lambda rng, s: (rng.uniform(0.3, 0.8),),
    cap=10.0,
)
def lopsided_dead_zone(t, y, v, u, z, dz, p, f, i, j):
    """A dead zone that is narrower for negative commands."""
    width = p[0] if u[i] > 0.0 else p[0] * p[1]
    f[i] -= copysign(min(abs(u[i]), width), u[i])


@law(
    "cogging-with-harmonic",
    "twisted",
    _PART,
    lambda s: 0.1 * s.u_rms,
    effect="periodic-torque",
    shapes=lambda rng, s: (s.y_peak * log_uniform(rng, 0.15, 0.5), rng.uniform(0.3, 0.6), rng.uniform(0.0, 6.28)),
)
def cogging_with_harmonic(t, y, v, u, z, dz, p, f, i, j):
    """A cogging torque with a second harmonic."""
    phase = 6.283185307179586 * y[i] / p[1]
    f[i] += p[0] * (sin(phase) + p[2] * sin(2.0 * phase + p[3]))


@law(
    "bent-saturation",
    "twisted",
    "drive",
    lambda s: 0.1,
    effect="amplifier-saturation",
    shapes=lambda rng, s: (s.u_peak, rng.uniform(0.2, 0.5)),
    cap=6.0,
)
def bent_saturation(t, y, v, u, z, dz, p, f, i, j):
    """An amplifier that bends at two levels, the second one for positive commands only."""
    first, second = (1.0 - p[0]) * p[1], (1.0 - 0.5 * p[0]) * p[1]
    over = max(abs(u[i]) - first, 0.0)
    more = max(u[i] - second, 0.0)
    f[i] -= copysign(p[2] * over, u[i]) + (1.0 - p[2]) * more
