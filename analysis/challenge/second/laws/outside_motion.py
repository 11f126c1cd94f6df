"""Laws of drag and of several axes that are not listed."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from math import sin

from analysis.challenge.second.law import law, log_uniform

_PART = "structure"


@law("square-drag", "unlisted", _PART, lambda s: 0.1 * s.u_rms / s.v_rms**2, cap=8.0)
def square_drag(t, y, v, u, z, dz, p, f, i, j):
    """Drag with the square of the rate."""
    f[i] -= p[0] * v[i] * abs(v[i])


@law("placed-drag", "unlisted", _PART, lambda s: 0.1 * s.u_rms / (s.v_rms * s.y_rms**2), cap=8.0)
def placed_drag(t, y, v, u, z, dz, p, f, i, j):
    """Drag that grows with the square of the deflection."""
    f[i] -= p[0] * y[i] * y[i] * v[i]


@law(
    "eddy-brake",
    "unlisted",
    _PART,
    lambda s: 0.1 * s.u_rms / s.v_rms,
    shapes=lambda rng, s: (s.v_rms * rng.uniform(0.6, 1.5),),
    cap=8.0,
)
def eddy_brake(t, y, v, u, z, dz, p, f, i, j):
    """An eddy-current brake: its drag falls beyond a critical rate."""
    f[i] -= p[0] * v[i] / (1.0 + (v[i] / p[1]) ** 2)


@law(
    "wobbling-gyroscope",
    "unlisted",
    _PART,
    lambda s: 0.05 * s.u_rms / s.v_rms,
    axes=2,
    shapes=lambda rng, s: (6.28 * s.frequency_hz * log_uniform(rng, 0.05, 0.3),),
)
def wobbling_gyroscope(t, y, v, u, z, dz, p, f, i, j):
    """A rotor between two axes, whose speed wobbles."""
    spin = p[0] * (1.0 + 0.5 * sin(p[1] * t))
    f[i] -= spin * v[j]
    f[j] += spin * v[i]


@law("quadratic-exchange", "unlisted", _PART, lambda s: 0.1 * s.slope / s.y_rms, axes=2)
def quadratic_exchange(t, y, v, u, z, dz, p, f, i, j):
    """Two axes that pump energy into each other: a potential with the square of one times the other."""
    f[i] -= 2.0 * p[0] * y[i] * y[j]
    f[j] -= p[0] * y[i] * y[i]
