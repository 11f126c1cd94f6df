"""Listed laws of the sensor: the reading of a true position."""
# mypy: disable-error-code="no-untyped-def"

from __future__ import annotations

from math import copysign, floor, sin

from analysis.challenge.second.law import law, log_uniform

_PART = "sensor"


@law(
    "reading-gain",
    "listed",
    _PART,
    lambda s: 0.1,
    how="reading",
    effect="sensor-gain",
    parameter="relative",
    cap=5.0,
    alone=False,
)
def reading_gain(t, y, v, u, z, p, r, i, j):
    """A gain that is off."""
    r[i] += p[0] * y[i]


@law(
    "turned-sensor", "listed", _PART, lambda s: 0.05, how="reading", effect="sensor-rotation", axes=2, parameter="angle"
)
def turned_sensor(t, y, v, u, z, p, r, i, j):
    """A sensor that sees another axis."""
    r[i] += p[0] * y[j]


@law(
    "wavy-reading",
    "listed",
    _PART,
    lambda s: 0.01 * s.y_rms,
    how="reading",
    effect="periodic-sensor-error",
    shapes=lambda rng, s: (s.y_peak * log_uniform(rng, 0.05, 0.4), rng.uniform(0.0, 6.28)),
)
def wavy_reading(t, y, v, u, z, p, r, i, j):
    """An error that repeats at even distances."""
    r[i] += p[0] * sin(6.283185307179586 * y[i] / p[1] + p[2])


@law(
    "rounded-reading",
    "listed",
    _PART,
    lambda s: 0.01 * s.y_rms,
    how="reading",
    effect="sensor-quantisation",
    parameter="step_size",
    cap=10.0,
)
def rounded_reading(t, y, v, u, z, p, r, i, j):
    """A sensor with steps; what noise is recorded comes behind it."""
    r[i] = p[0] * floor(r[i] / p[0] + 0.5)


@law(
    "missed-fringes",
    "listed",
    _PART,
    lambda s: 0.01 * s.y_rms,
    how="reading",
    effect="fringe-jump",
    states=2,
    shapes=lambda rng, s: (s.v_peak * rng.uniform(0.6, 0.9),),
    parameter="fringe",
)
def missed_fringes(t, y, v, u, z, p, r, i, j):
    """A fringe counter that misses one fringe p[0] each time the rate rises above p[1]; the offset stays."""
    fast = abs(v[i]) > p[1]
    if fast and z[1] == 0.0:
        z[0] -= copysign(p[0], v[i])
    z[1] = 1.0 if fast else 0.0
    r[i] += z[0]


@law(
    "curved-drift",
    "listed",
    _PART,
    lambda s: 0.02 * s.y_rms / s.run_s,
    how="reading",
    effect="sensor-drift",
    shapes=lambda rng, s: (rng.uniform(-0.3, 0.3) / s.run_s,),
)
def curved_drift(t, y, v, u, z, p, r, i, j):
    """A zero that drifts, by up to a third faster or slower towards the end."""
    r[i] += p[0] * t * (1.0 + p[1] * t)
