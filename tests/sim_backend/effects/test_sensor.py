"""Effects of the sensors against closed forms and statistics."""

import numpy as np
import pytest

from sim_backend.effects import make_effect
from tests.sim_backend.effects.along import along
from tests.sim_backend.test_kernel import held_torque, one_axis, play


def test_sensor_gain_scales_the_reading_and_not_the_motion():
    torque = held_torque(500)
    got = play(one_axis([("sensor-gain", {"relative": -0.005})]), torque, truth=True)
    np.testing.assert_allclose(got["theta_x"], 0.995 * got["true_theta_x"], rtol=1e-14)
    np.testing.assert_array_equal(got["true_theta_x"], play(one_axis(), torque)["theta_x"])


def test_rotation_by_a_small_angle_mixes_the_axes():
    x, y = np.array([1e-3, 0.0, 2e-3]), np.array([0.0, 1e-3, -1e-3])
    angle = 1e-2
    seen = x + along(make_effect("sensor-rotation", "theta_y->theta_x", {"angle": angle}), signal=x, aux=y)
    rotated = np.cos(angle) * x + np.sin(angle) * y
    np.testing.assert_allclose(seen, rotated, rtol=0, atol=angle**2 * 2e-3)  # small angles: to second order


def test_periodic_error_follows_the_position():
    effect = make_effect("periodic-sensor-error", "theta_x", {"cosine": 3e-9, "sine": 4e-9, "period": 1e-5})
    x = np.linspace(0, 5e-5, 401)
    error = along(effect, position=x, signal=np.full(401, 7.0))
    np.testing.assert_allclose(error, 5e-9 * np.cos(2 * np.pi * x / 1e-5 - np.arctan2(4, 3)), rtol=0, atol=1e-22)


def test_one_fringe_is_lost_per_excursion_and_regained_on_the_way_back():
    effect = make_effect("fringe-jump", "theta_x", {"fringe": 1e-6, "rate_limit": 1.0})
    # beyond the limit; noise about it; slow; beyond it backwards; slow; forwards again
    rate = np.array([0.0, 1.2, 0.9, 1.1, 0.6, 0.2, -1.5, -0.1, 1.1, 3.0, 0.0])
    lost = [0, -1, -1, -1, -1, -1, 0, 0, -1, -1, -1]
    np.testing.assert_allclose(along(effect, rate=rate), 1e-6 * np.array(lost), rtol=0, atol=1e-21)


def test_fringe_jump_leaves_the_bench_reading_off_by_whole_fringes():
    torque = np.concatenate([np.full(300, 0.08), np.zeros(700)])
    got = play(one_axis([("fringe-jump", {"fringe": 1e-6, "rate_limit": 0.5})]), torque, truth=True)
    fringes = (got["theta_x"] - got["true_theta_x"]) / 1e-6
    # readings of 1e-2 rounded to 1e-16 of themselves
    np.testing.assert_allclose(fringes, np.rint(fringes), rtol=0, atol=1e-10)
    assert np.ptp(fringes) == pytest.approx(1.0, abs=1e-9)


def test_apex_noise_grows_as_stated():
    n, x = 40_000, 5e-3
    effect = make_effect("apex-noise", "theta_x", {"linear": 1e-6, "quadratic": 3e-4})
    drawn = effect.draw(n, 1e4, np.random.default_rng(0))
    for side in (-x, x):
        noise = along(effect, position=np.full(n, side), aux=drawn)
        # a standard deviation from n draws scatters by 1/sqrt(2 n) = 0.35 %
        assert np.std(noise) == pytest.approx(1e-6 * x + 3e-4 * x**2, rel=4 * 0.0035)
    np.testing.assert_array_equal(along(effect, position=np.zeros(n), aux=drawn), 0.0)


def test_two_sources_of_noise_at_one_place_are_independent():
    torque = np.full(3000, 0.05)
    pair = [("apex-noise", {"linear": 1e-3}), ("apex-noise", {"linear": 1e-3})]
    single = play(one_axis(pair[:1]), torque, truth=True)
    double = play(one_axis(pair), torque, truth=True)
    first = single["theta_x"] - single["true_theta_x"]
    second = double["theta_x"] - double["true_theta_x"] - first
    # the correlation of 3000 independent draws scatters by 1/sqrt(3000)
    assert abs(np.corrcoef(first, second)[0, 1]) < 5 / np.sqrt(3000)


def test_drift_is_linear_in_time_over_segments_too():
    effect = make_effect("sensor-drift", "theta_x", {"drift": 2e-6})
    np.testing.assert_allclose(along(effect, position=np.zeros(5), dt_s=0.1), 2e-7 * np.arange(5), rtol=0, atol=1e-21)
    got = play(one_axis([("sensor-drift", {"drift": 1e-3})]), np.zeros(100), n_samples=250)["theta_x"]
    np.testing.assert_allclose(got, 1e-7 * np.arange(250), rtol=0, atol=1e-18)
