"""Laws of the drive that are not listed."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from math import sin

from analysis.challenge.second.law import law, log_uniform

_PART = "drive"


@law(
    "limited-slew",
    "unlisted",
    _PART,
    lambda s: 0.3,
    states=1,
    shapes=lambda rng, s: (0.05 / s.frequency_hz, s.u_rms * 6.28 * s.frequency_hz),
    cap=10.0,
    rate=lambda p, s: 100.0 / p[1],
)
def limited_slew(t, y, v, u, z, dz, p, f, i, j):
    """An amplifier with a lag of p[1] / 100 seconds and a limited slew rate, 3 p[2] / p[0] a second."""
    fast = p[2] * 3.0 / p[0]
    dz[0] = min(max((u[i] - z[0]) / (0.01 * p[1]), -fast), fast)
    f[i] += z[0] - u[i]


@law("even-drive", "unlisted", _PART, lambda s: 0.1 / s.u_rms)
def even_drive(t, y, v, u, z, dz, p, f, i, j):
    """A drive whose torque has a part with the square of the command."""
    f[i] += p[0] * u[i] * u[i]


@law("back-emf", "unlisted", _PART, lambda s: 0.1 / s.v_rms)
def back_emf(t, y, v, u, z, dz, p, f, i, j):
    """A drive whose torque falls with command times rate."""
    f[i] -= p[0] * u[i] * v[i]


@law(
    "mains-gain",
    "unlisted",
    _PART,
    lambda s: 0.05,
    shapes=lambda rng, s: (6.28 * s.frequency_hz * log_uniform(rng, 0.1, 1.0), rng.uniform(0.0, 6.28)),
)
def mains_gain(t, y, v, u, z, dz, p, f, i, j):
    """A gain that the mains modulate."""
    f[i] += p[0] * sin(p[1] * t + p[2]) * u[i]


@law(
    "falling-out",
    "unlisted",
    _PART,
    lambda s: 0.1,
    shapes=lambda rng, s: (s.run_s * rng.uniform(0.05, 0.15), rng.uniform(0.05, 0.2)),
    cap=10.0,
)
def falling_out(t, y, v, u, z, dz, p, f, i, j):
    """A contact that opens: every `p[1]` seconds the drive loses a part of its torque for a while."""
    if (t / p[1]) % 1.0 < p[2]:
        f[i] -= p[0] * u[i]


@law("sudden-age", "unlisted", _PART, lambda s: 0.05, shapes=lambda rng, s: (s.run_s * rng.uniform(0.2, 0.6),))
def sudden_age(t, y, v, u, z, dz, p, f, i, j):
    """A gain that falls at once, at some time."""
    if t > p[1]:
        f[i] -= p[0] * u[i]
