"""Fourth-order reference trajectory: a move with bounded velocity, acceleration, jerk and its derivative.

The derivative of jerk is piecewise constant, in fifteen stretches built from four durations (Lambrechts,
Boerlage and Steinbuch, Control Engineering Practice 13, 2005; [36] of the paper). With ramp = ramp of jerk,
then constant jerk, acceleration and velocity for the durations t_d, t_j, t_a and t_v, the peaks follow from
each other:

    jerk j = d t_d,  acceleration a = j (t_d + t_j),  velocity v = a (2 t_d + t_j + t_a),
    distance x = v (2 (2 t_d + t_j) + t_a + t_v)

so each duration is the largest within all bounds, from the innermost out, in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sim_backend.errors import ConfigError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MotionLimits:
    """Largest velocity, acceleration, jerk and derivative of jerk, per second, s², s³ and s⁴, in units of the output.

    Raises ConfigError when one is not positive and finite.
    """

    velocity: float
    acceleration: float
    jerk: float
    djerk: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value > 0.0):
                raise ConfigError(f"profile: the limit of {name} is {value}; it must be a finite number above zero")


@dataclass(frozen=True)
class Profile:
    """A sampled move: `position`, `velocity`, `acceleration`, `jerk` and `djerk`, each (n + 1,), at `rate_hz`.

    The first sample is the start at rest, the last the end at rest. `durations` (4,) are t_d, t_j, t_a, t_v
    in whole samples; `djerk` holds from its sample to the next.
    """

    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    djerk: Array
    durations: NDArray[np.int64]
    rate_hz: float


def switching_durations(distance: float, limits: MotionLimits) -> Array:
    """Return (t_d, t_j, t_a, t_v) in s of the fastest symmetric move over `distance` (output units, sign ignored).

    Raises ConfigError when the distance is not finite.
    """
    x = abs(distance)
    if not np.isfinite(x):
        raise ConfigError(f"profile: the distance is {distance}; it must be a finite number")
    if x == 0.0:
        return np.zeros(4)
    d, v, a = limits.djerk, limits.velocity, limits.acceleration
    # t_j = t_a = t_v = 0: j = d t, a = d t², v = 2 d t³, x = 8 d t⁴
    t_d = min((x / (8.0 * d)) ** 0.25, (v / (2.0 * d)) ** (1.0 / 3.0), (a / d) ** 0.5, limits.jerk / d)
    j = d * t_d
    # from a: t_d + t_j = a/j; from v: (w - t_d) w = v/j; from x: 2 (w - t_d) w² = x/j, all with w = 2 t_d + t_j
    by_velocity = 0.5 * t_d + np.sqrt(0.25 * t_d**2 + v / j)
    width = min(a / j + t_d, by_velocity, _cubic(t_d, x / (2.0 * j)))
    t_j = max(width - 2.0 * t_d, 0.0)
    rise = 2.0 * t_d + t_j
    a = j * (t_d + t_j)
    # from v: rise + t_a = v/a; from x: (rise + t_a)(2 rise + t_a) = x/a
    t_a = max(min(v / a, -0.5 * rise + np.sqrt(0.25 * rise**2 + x / a)) - rise, 0.0)
    v = a * (rise + t_a)
    t_v = max(x / v - 2.0 * rise - t_a, 0.0)
    return np.array([t_d, t_j, t_a, t_v])


def _cubic(t: float, value: float) -> float:
    """Positive root w of w³ - t w² = value, by Cardano; its discriminant is never negative for t, value >= 0."""
    third = t / 3.0
    half = third**3 + 0.5 * value
    root = np.sqrt(max(half**2 - third**6, 0.0))
    outer = np.cbrt(half + root)
    # the other cube root, of half - root, would lose its digits; the product of the two is third²
    return float(third + outer + third**2 / outer)


def fourth_order(start: float, end: float, limits: MotionLimits, rate_hz: float) -> Profile:
    """Return the fastest move from `start` to `end` whose switching times fall on samples.

    Each duration is rounded up to whole samples and the derivative of jerk is then lowered to the value that
    hits the end: longer durations lower every peak, so no limit is broken. Raises ConfigError when the rate
    is not positive.
    """
    if not (np.isfinite(rate_hz) and rate_hz > 0.0):
        raise ConfigError(f"profile: the sample rate is {rate_hz} Hz; it must be a finite number above zero")
    distance = end - start
    # one part in 1e9 of a sample is rounding, not a reason for another sample
    n = np.ceil(switching_durations(distance, limits) * rate_hz - 1e-9).astype(np.int64)
    if distance != 0.0:
        n[0] = max(n[0], 1)
    t_d, t_j, t_a, t_v = n / rate_hz
    rise = 2.0 * t_d + t_j
    unit = t_d * (t_d + t_j) * (rise + t_a) * (2.0 * rise + t_a + t_v)
    djerk = distance / unit if distance != 0.0 else 0.0
    ramp = [(n[0], 1), (n[1], 0), (n[0], -1)]
    back = [(count, -sign) for count, sign in ramp]
    push = [*ramp, (n[2], 0), *back]
    pull = [(count, -sign) for count, sign in push]
    stretches = [*push, (n[3], 0), *pull]
    snap = np.concatenate([np.full(int(count), sign * djerk) for count, sign in stretches] + [np.zeros(1)])
    states = _integrate(snap, 1.0 / rate_hz)
    position = start + states[0]
    if distance != 0.0:
        position[-1] = end
    return Profile(position, states[1], states[2], states[3], snap, n, float(rate_hz))


def _integrate(snap: Array, dt_s: float) -> Array:
    """Position, velocity, acceleration and jerk (4, n) from piecewise constant snap (n,): exact sums, no quadrature.

    Each derivative rises by the Taylor series of the ones below it over one sample.
    """

    def summed(increment: Array) -> Array:
        return np.concatenate([[0.0], np.cumsum(increment[:-1])])

    jerk = summed(snap * dt_s)
    acceleration = summed(jerk * dt_s + snap * dt_s**2 / 2.0)
    velocity = summed(acceleration * dt_s + jerk * dt_s**2 / 2.0 + snap * dt_s**3 / 6.0)
    position = summed(velocity * dt_s + acceleration * dt_s**2 / 2.0 + jerk * dt_s**3 / 6.0 + snap * dt_s**4 / 24.0)
    return np.stack([position, velocity, acceleration, jerk])
