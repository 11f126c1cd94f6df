"""The fourth-order profile: bounds, end points and switching times, by property and by quadrature."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PPoly

from sim_backend.control.profile import MotionLimits, fourth_order, switching_durations
from sim_backend.errors import ConfigError

RATE_HZ = 10_000.0
DISTANCES = st.floats(1e-6, 2e-2) | st.floats(-2e-2, -1e-6)
LIMITS = st.builds(MotionLimits, st.floats(0.1, 20.0), st.floats(50.0, 2e4), st.floats(5e4, 2e7), st.floats(1e8, 1e11))


def _peaks(t, djerk):
    """Peaks of (jerk, acceleration, velocity) and the distance of the four durations."""
    jerk = djerk * t[0]
    acceleration = jerk * (t[0] + t[1])
    velocity = acceleration * (2 * t[0] + t[1] + t[2])
    return jerk, acceleration, velocity, velocity * (4 * t[0] + 2 * t[1] + t[2] + t[3])


@given(DISTANCES, LIMITS)
def test_limits_are_never_exceeded_and_the_end_is_exact(distance, limits):
    p = fourth_order(1e-3, 1e-3 + distance, limits, RATE_HZ)
    # durations are whole samples to one part in 1e9 of a sample, and every peak is a product of at most four of them
    slack = 1 + 1e-8
    for name in ("velocity", "acceleration", "jerk", "djerk"):
        assert np.max(np.abs(getattr(p, name))) <= slack * getattr(limits, name)
    assert p.position[0] == 1e-3
    assert p.position[-1] == 1e-3 + distance
    # what the sums themselves arrive at: rounding of at most a few thousand additions
    step = np.diff(p.position[-2:])[0] - p.velocity[-2] / RATE_HZ - p.acceleration[-2] / RATE_HZ**2 / 2
    step -= p.jerk[-2] / RATE_HZ**3 / 6 + p.djerk[-2] / RATE_HZ**4 / 24
    assert abs(step) < 1e-11 * abs(distance) + 1e-15
    assert abs(p.velocity[-1]) < 1e-10 * np.max(np.abs(p.velocity))
    assert np.all(np.diff(p.position) * np.sign(distance) >= -1e-12 * abs(distance))


@given(DISTANCES, LIMITS)
def test_every_duration_is_as_long_as_the_bounds_allow(distance, limits):
    """The distance is met, and each stage ends on its own bound or is followed by nothing."""
    t = switching_durations(distance, limits)
    jerk, acceleration, velocity, reached = _peaks(t, limits.djerk)
    assert np.isclose(reached, abs(distance), rtol=1e-9)
    near = 1 - 1e-6
    real = 1e-12 * t.sum()  # shorter is the rounding of a difference
    if t[1] > real:
        assert np.isclose(jerk, limits.jerk, rtol=1e-9)
    if t[2] > real:
        assert np.isclose(acceleration, limits.acceleration, rtol=1e-9)
    if t[3] > real:
        # cruising only at the limit of velocity, or where an inner limit was met first
        assert (
            velocity >= near * limits.velocity
            or jerk >= near * limits.jerk
            or acceleration >= near * limits.acceleration
        )
    assert max(velocity / limits.velocity, acceleration / limits.acceleration, jerk / limits.jerk) < 1 + 1e-9


def test_known_move_with_all_phases():
    """Limits chosen so that every duration is a round number: t_d = 1, t_j = 2, t_a = 3, t_v = 4 ms."""
    d = 1e9
    jerk, acceleration, velocity, distance = _peaks(np.array([1e-3, 2e-3, 3e-3, 4e-3]), d)
    limits = MotionLimits(velocity, acceleration, jerk, d)
    assert np.allclose(switching_durations(distance, limits), [1e-3, 2e-3, 3e-3, 4e-3], rtol=1e-9)
    p = fourth_order(0.0, distance, limits, RATE_HZ)
    assert p.durations.tolist() == [10, 20, 30, 40]
    assert p.position.size == 1 + 8 * 10 + 4 * 20 + 2 * 30 + 40


def test_samples_equal_the_exact_integral_of_the_derivative_of_jerk():
    p = fourth_order(-2e-3, 8.5e-3, MotionLimits(4.0, 2000.0, 2e6, 4e9), RATE_HZ)
    time = np.arange(p.djerk.size) / RATE_HZ
    jerk = PPoly(p.djerk[None, :-1], time).antiderivative()
    chain = [jerk, jerk.antiderivative(), jerk.antiderivative(2), jerk.antiderivative(3)]
    for exact, sampled in zip(chain, (p.jerk, p.acceleration, p.velocity, p.position + 2e-3), strict=True):
        assert np.allclose(exact(time), sampled, atol=1e-10 * np.max(np.abs(sampled)))


def test_no_move_is_one_sample_at_rest():
    p = fourth_order(1e-3, 1e-3, MotionLimits(1.0, 1.0, 1.0, 1.0), RATE_HZ)
    assert p.position.tolist() == [1e-3]


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: MotionLimits(1.0, -1.0, 1.0, 1.0), "acceleration"),
        (lambda: fourth_order(0.0, 1.0, MotionLimits(1.0, 1.0, 1.0, 1.0), 0.0), "rate"),
        (lambda: switching_durations(np.nan, MotionLimits(1.0, 1.0, 1.0, 1.0)), "distance"),
    ],
)
def test_what_cannot_be_is_refused(call, word):
    with pytest.raises(ConfigError, match=word):
        call()
