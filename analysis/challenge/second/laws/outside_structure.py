"""Laws of the structure that are not listed, nor a variant of a listed one."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from math import sin, sqrt, tanh

from analysis.challenge.second.law import law, log_uniform

_PART = "structure"


@law(
    "pumped-stiffness",
    "unlisted",
    _PART,
    lambda s: 0.05 * s.slope,
    shapes=lambda rng, s: (6.28 * s.frequency_hz * log_uniform(rng, 0.15, 3.0), rng.uniform(0.0, 6.28)),
)
def pumped_stiffness(t, y, v, u, z, dz, p, f, i, j):
    """A stiffness that is modulated at a frequency of its own (Mathieu's equation)."""
    f[i] -= p[0] * sin(p[1] * t + p[2]) * y[i]


@law(
    "small-motion-drive",
    "unlisted",
    _PART,
    lambda s: 0.05 * s.u_rms / s.v_rms,
    shapes=lambda rng, s: (s.y_rms * rng.uniform(0.3, 1.0),),
    cap=8.0,
)
def small_motion_drive(t, y, v, u, z, dz, p, f, i, j):
    """Damping that is negative while the deflection is small (B. van der Pol, 1926), bounded beyond."""
    q = (y[i] / p[1]) ** 2
    f[i] += p[0] * v[i] * (1.0 - q) / (1.0 + 0.2 * q)


@law(
    "loose-mass",
    "unlisted",
    _PART,
    lambda s: 0.05 * s.inertia,
    states=2,
    shapes=lambda rng, s: (s.y_rms * rng.uniform(0.2, 0.8), 6.28 * s.frequency_hz * rng.uniform(3.0, 6.0)),
    rate=lambda p, s: p[2],
)
def loose_mass(t, y, v, u, z, dz, p, f, i, j):
    """A mass that is loose in a cage and knocks against its walls."""
    apart = z[0] - y[i]
    depth = apart - p[1] if apart > p[1] else (apart + p[1] if apart < -p[1] else 0.0)
    push = p[2] * p[2] * depth + (0.6 * p[2] * (z[1] - v[i]) if depth != 0.0 else 0.0)
    dz[0] = z[1]
    dz[1] = -push
    f[i] += p[0] * push


@law(
    "magnetic-pull",
    "unlisted",
    _PART,
    lambda s: 0.02 * s.u_rms,
    shapes=lambda rng, s: (s.y_peak * rng.uniform(1.6, 3.0),),
    springy=True,
    cap=10.0,
)
def magnetic_pull(t, y, v, u, z, dz, p, f, i, j):
    """The pull of a magnet on one side, with the inverse square of the gap."""
    gap = max(1.0 - y[i] / p[1], 0.2)
    f[i] += p[0] * (1.0 / (gap * gap) - 1.0)


@law(
    "flag-loop",
    "unlisted",
    _PART,
    lambda s: 0.1 * s.u_rms,
    states=1,
    shapes=lambda rng, s: (s.y_peak * rng.uniform(0.25, 0.5), s.y_peak * rng.uniform(0.2, 0.4)),
    rate=lambda p, s: 5.0 * s.v_peak / p[2],
)
def flag_loop(t, y, v, u, z, dz, p, f, i, j):
    """A wire of shape-memory alloy, pulled one way only: it yields beyond `p[1]` and returns by another path."""
    stretch = (y[i] - p[1]) / p[2]
    high, low = min(max(stretch, 0.0), 1.0), min(max(stretch + 0.6, 0.0), 1.0)
    goal = high if v[i] > 0.0 else low
    moves = (goal > z[0]) if v[i] > 0.0 else (goal < z[0])
    dz[0] = 5.0 * abs(v[i]) / p[2] * (goal - z[0]) if moves else 0.0
    f[i] -= p[0] * z[0]


@law(
    "fractional-damper",
    "unlisted",
    _PART,
    lambda s: 0.1 * s.slope,
    states=5,
    shapes=lambda rng, s: (1.0 / (6.28 * s.frequency_hz), rng.uniform(0.3, 0.7)),
    rate=lambda p, s: 18.0 / p[1],
)
def fractional_damper(t, y, v, u, z, dz, p, f, i, j):
    """A damper of fractional order, by five relaxing springs over two and a half decades (A. Oustaloup, 1991)."""
    for k in range(5):
        time = p[1] * 10.0 ** (1.25 - 0.625 * k)
        dz[k] = (y[i] - z[k]) / time
        f[i] -= p[0] * 10.0 ** (p[2] * 0.625 * (k - 2)) * (y[i] - z[k])


@law("slack-cable", "unlisted", _PART, lambda s: 0.1 * s.slope, states=1, shapes=lambda rng, s: (s.y_rms * 0.2,))
def slack_cable(t, y, v, u, z, dz, p, f, i, j):
    """A cable that pulls in one direction only, whose anchor creeps after the largest stretch and returns."""
    stretch = y[i] - z[0]
    taut = 0.5 * (stretch + sqrt(stretch * stretch + p[1] * p[1]))
    dz[0] = 0.1 * abs(v[i]) * tanh((stretch - 2.0 * p[1]) / p[1])
    f[i] -= p[0] * (taut - 0.5 * p[1])


@law(
    "swinging-pendulum",
    "unlisted",
    _PART,
    lambda s: 0.1 * s.u_rms,
    states=2,
    shapes=lambda rng, s: (3.14 * s.frequency_hz * rng.uniform(0.9, 1.1), s.y_peak, s.y_rms),
)
def swinging_pendulum(t, y, v, u, z, dz, p, f, i, j):
    """A pendulum that hangs on the moving part: its length follows the motion, and its swing pulls with its square."""
    dz[0] = z[1]
    swing = p[1] * p[1]
    dz[1] = -0.1 * p[1] * z[1] - swing * z[0] * (1.0 + 0.5 * y[i] / p[2]) + 0.5 * swing * y[i] / p[3]
    f[i] -= p[0] * z[0] * z[0] / (1.0 + z[0] * z[0])
