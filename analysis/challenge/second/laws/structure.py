"""Listed laws of the structure, with shapes up to the borders of their names."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from math import copysign, sin, sqrt, tanh

from analysis.challenge.second.law import law, log_uniform

_PART = "structure"


@law(
    "cubic-hardening",
    "listed",
    _PART,
    lambda s: 0.1 * s.slope / s.y_rms**2,
    effect="cubic-stiffness",
    parameter="stiffness",
)
def cubic_hardening(t, y, v, u, z, dz, p, f, i, j):
    """A hardening spring: a restoring torque p[0]·y³, so that its stiffness 3 p[0]·y² grows with the deflection."""
    f[i] -= p[0] * y[i] ** 3


@law(
    "cubic-softening",
    "listed",
    _PART,
    lambda s: 0.05 * s.slope / s.y_peak**2,
    effect="cubic-stiffness",
    springy=True,
    cap=6.0,
)
def cubic_softening(t, y, v, u, z, dz, p, f, i, j):
    """A softening spring: the restoring torque is lower by p[0]·y³."""
    f[i] += p[0] * y[i] ** 3


@law(
    "smooth-coulomb",
    "listed",
    _PART,
    lambda s: 0.1 * s.u_rms,
    effect="coulomb-friction",
    shapes=lambda rng, s: (s.v_rms * log_uniform(rng, 1e-3, 5e-2),),
    parameter="torque",
    rate=lambda p, s: p[0] / (p[1] * s.inertia),
)
def smooth_coulomb(t, y, v, u, z, dz, p, f, i, j):
    """Friction of one size, smoothed over a rate of up to 5 % of the usual."""
    f[i] -= p[0] * tanh(v[i] / p[1])


@law(
    "presliding",
    "listed",
    _PART,
    lambda s: 0.1 * s.u_rms,
    effect="coulomb-friction",
    states=1,
    shapes=lambda rng, s: (max(s.y_rms * log_uniform(rng, 2e-3, 1.5e-2), s.v_peak / (20.0 * s.rate_hz)),),
    parameter="torque",
    rate=lambda p, s: s.v_peak / p[1],
)
def presliding(t, y, v, u, z, dz, p, f, i, j):
    """Friction that gives before it slides (P. R. Dahl, 1968): its spring turns over `p[1]`, below 2 % of the swing."""
    bend = min(max(z[0], -1.5), 1.5)
    dz[0] = (v[i] - abs(v[i]) * bend) / p[1]
    f[i] -= p[0] * bend


@law(
    "smooth-loop",
    "listed",
    _PART,
    lambda s: 0.1 * s.u_rms,
    effect="hysteresis",
    states=1,
    shapes=lambda rng, s: (s.y_peak * log_uniform(rng, 0.06, 0.5), rng.uniform(1.0, 2.0)),
    rate=lambda p, s: 2.0 * s.v_peak / p[1],
)
def smooth_loop(t, y, v, u, z, dz, p, f, i, j):
    """A loop that turns over 6 to 50 % of the swing, by an equation of Duhem's kind with a power between 1 and 2."""
    size = abs(z[0]) ** p[2]
    dz[0] = (v[i] - abs(v[i]) * copysign(size, z[0])) / p[1]
    f[i] -= p[0] * z[0]


@law(
    "relaxing-spring",
    "listed",
    _PART,
    lambda s: 0.1 * s.slope,
    effect="viscoelastic-creep",
    states=1,
    shapes=lambda rng, s: (s.run_s * log_uniform(rng, 0.01, 0.2),),
    parameter="stiffness",
)
def relaxing_spring(t, y, v, u, z, dz, p, f, i, j):
    """A spring behind a dashpot (Maxwell's element)."""
    dz[0] = (y[i] - z[0]) / p[1]
    f[i] -= p[0] * (y[i] - z[0])


@law(
    "soft-stop",
    "listed",
    _PART,
    lambda s: s.slope,
    effect="end-stop-contact",
    shapes=lambda rng, s: (s.y_peak * rng.uniform(0.55, 0.85), s.y_peak * 0.01, rng.uniform(0.0, 0.3) / s.frequency_hz),
    rate=lambda p, s: float(sqrt(p[0] / s.inertia)) + p[0] * p[3] / s.inertia,
)
def soft_stop(t, y, v, u, z, dz, p, f, i, j):
    """Stops on both sides whose contact grows over 1 % of the travel, with damping while they are pressed."""
    depth = abs(y[i]) - p[1]
    touch = 0.5 * (depth + sqrt(depth * depth + p[2] * p[2]))
    inside = 0.5 * (1.0 + depth / sqrt(depth * depth + p[2] * p[2]))
    f[i] -= p[0] * (copysign(touch, y[i]) + inside * touch / (touch + p[1]) * p[3] * v[i])


@law(
    "soft-play",
    "listed",
    _PART,
    lambda s: 0.3 * s.stiffness,
    effect="backlash",
    shapes=lambda rng, s: (s.y_peak * rng.uniform(0.03, 0.3),),
    springy=True,
    cap=2.5,
    rate=lambda p, s: float(sqrt(p[0] / s.inertia)),
)
def soft_play(t, y, v, u, z, dz, p, f, i, j):
    """Stiffness that is missing within a play, whose contact sets in over a tenth of it."""
    f[i] += p[0] * p[1] * tanh(y[i] / p[1]) if abs(y[i]) < 3.0 * p[1] else p[0] * copysign(p[1], y[i])


@law(
    "cogging",
    "listed",
    _PART,
    lambda s: 0.1 * s.u_rms,
    effect="periodic-torque",
    shapes=lambda rng, s: (s.y_peak * log_uniform(rng, 0.1, 0.5), rng.uniform(0.0, 6.28)),
    rate=lambda p, s: float(sqrt(6.3 * p[0] / (p[1] * s.inertia))),
)
def cogging(t, y, v, u, z, dz, p, f, i, j):
    """A torque that repeats at even distances."""
    f[i] += p[0] * sin(6.283185307179586 * y[i] / p[1] + p[2])


@law(
    "appended-mass",
    "listed",
    _PART,
    lambda s: 0.02 * s.inertia,
    effect="extra-resonance",
    states=2,
    shapes=lambda rng, s: (6.28 * s.frequency_hz * log_uniform(rng, 1.5, 4.0), log_uniform(rng, 5e-3, 0.05)),
    rate=lambda p, s: p[1],
)
def appended_mass(t, y, v, u, z, dz, p, f, i, j):
    """A small mass on a spring, a resonance that the nominal model lacks."""
    pull = p[1] * p[1] * (z[0] - y[i]) + 2.0 * p[2] * p[1] * (z[1] - v[i])
    dz[0] = z[1]
    dz[1] = -pull
    f[i] += p[0] * pull


@law(
    "crosstalk",
    "listed",
    "drive",
    lambda s: 0.1,
    effect="cross-coupling",
    axes=2,
    parameter="gain",
)
def crosstalk(t, y, v, u, z, dz, p, f, i, j):
    """The command of one axis acts on another."""
    f[i] += p[0] * u[j]
