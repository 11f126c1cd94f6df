"""Listed laws of the drive: what becomes of a command on its way to a torque."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from math import copysign, floor, sqrt

from analysis.challenge.second.law import law, log_uniform

_PART = "drive"


@law("drive-gain", "listed", _PART, lambda s: 0.1, effect="actuator-gain", parameter="relative", cap=5.0, alone=False)
def drive_gain(t, y, v, u, z, dz, p, f, i, j):
    """A gain that is off."""
    f[i] += p[0] * u[i]


@law(
    "uneven-force-constant",
    "listed",
    _PART,
    lambda s: 0.1 / s.y_rms,
    effect="position-dependent-force-constant",
    shapes=lambda rng, s: (rng.uniform(-1.0, 1.0) / s.y_rms,),
)
def uneven_force_constant(t, y, v, u, z, dz, p, f, i, j):
    """A force constant that follows the position, with a linear and a quadratic part."""
    f[i] += p[0] * u[i] * y[i] * (1.0 + p[1] * y[i])


@law(
    "clipped-amplifier",
    "listed",
    _PART,
    lambda s: 0.1,
    effect="amplifier-saturation",
    shapes=lambda rng, s: (s.u_peak, rng.uniform(0.002, 0.05)),
    cap=6.0,
)
def clipped_amplifier(t, y, v, u, z, dz, p, f, i, j):
    """An amplifier whose limit is the part `p[0]` below the largest command, with a knee of `p[2]` of it."""
    limit, knee = (1.0 - p[0]) * p[1], p[2] * p[1]
    over = abs(u[i]) - limit
    f[i] -= copysign(0.5 * (over + sqrt(over * over + knee * knee)), u[i]) if over > -20.0 * knee else 0.0


@law(
    "lagging-amplifier",
    "listed",
    _PART,
    lambda s: 1.0 / s.rate_hz,
    effect="amplifier-lag",
    states=1,
    parameter="time_constant_s",
    cap=6.0,
    rate=lambda p, s: 1.0 / max(p[0], 1e-12),
)
def lagging_amplifier(t, y, v, u, z, dz, p, f, i, j):
    """An amplifier with a time constant."""
    dz[0] = (u[i] - z[0]) / max(p[0], 1e-12)
    f[i] += z[0] - u[i]


@law(
    "later-drive",
    "listed",
    _PART,
    lambda s: 0.3 / s.rate_hz,
    how="delay",
    effect="delay",
    parameter="seconds",
    cap=30.0,
    most_axes=1,
)
def later_drive() -> None:
    """A delay that the nominal model does not state: it is the simulator's own, of all drives."""


@law("soft-dead-zone", "listed", _PART, lambda s: 0.05 * s.u_rms, effect="dead-zone", parameter="width", cap=10.0)
def soft_dead_zone(t, y, v, u, z, dz, p, f, i, j):
    """A dead zone whose edges are round over a tenth of its width."""
    edge = 0.1 * p[0]
    over = abs(u[i]) - p[0]
    through = 0.5 * (over + sqrt(over * over + edge * edge)) - 0.5 * (sqrt(p[0] * p[0] + edge * edge) - p[0])
    f[i] += copysign(through, u[i]) - u[i]


@law("rounded-command", "listed", _PART, lambda s: 0.05 * s.u_rms, effect="command-quantisation", parameter="step_size")
def rounded_command(t, y, v, u, z, dz, p, f, i, j):
    """A converter of few bits."""
    f[i] += p[0] * floor(u[i] / p[0] + 0.5) - u[i]


@law(
    "warm-coil",
    "listed",
    _PART,
    lambda s: 0.1 / s.u_rms**2,
    effect="coil-heating",
    states=1,
    shapes=lambda rng, s: (s.run_s * log_uniform(rng, 0.03, 0.5),),
    parameter="coefficient",
)
def warm_coil(t, y, v, u, z, dz, p, f, i, j):
    """A coil that loses force as it warms."""
    dz[0] = (u[i] * u[i] - z[0]) / p[1]
    f[i] -= p[0] * z[0] * u[i]
