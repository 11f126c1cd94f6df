"""Effects of the drive against closed forms and plain numpy."""

import numpy as np
import pytest

from sim_backend.effects import make_effect
from sim_backend.errors import ConfigError
from tests.sim_backend.effects.along import along
from tests.sim_backend.test_kernel import RATE_HZ, STIFFNESS_NM_RAD, held_torque, one_axis, play

DT_S = 1 / RATE_HZ


def test_actuator_gain_scales_the_response():
    torque = held_torque(500)
    got = play(one_axis([("actuator-gain", {"relative": 0.01})]), torque)["theta_x"]
    np.testing.assert_allclose(got, 1.01 * play(one_axis(), torque)["theta_x"], rtol=1e-11, atol=1e-18)


def test_force_constant_by_hand():
    effect = make_effect("position-dependent-force-constant", "theta_x", {"linear": 2.0, "quadratic": -300.0})
    torque, x = np.array([0.1, -0.1, 0.2]), np.array([1e-3, 2e-3, -5e-3])
    np.testing.assert_allclose(along(effect, signal=torque, position=x), torque * (2 * x - 300 * x**2), rtol=1e-13)


def test_force_constant_shifts_the_rest_position():
    # k x = T (1 + q x²): the fixed point, by Newton's rule from the linear one
    torque_nm, q = 0.05, -2000.0
    x = torque_nm / STIFFNESS_NM_RAD
    for _ in range(20):
        x -= (STIFFNESS_NM_RAD * x - torque_nm * (1 + q * x**2)) / (STIFFNESS_NM_RAD - 2 * q * torque_nm * x)
    model = one_axis([("position-dependent-force-constant", {"quadratic": q})], sigma=60.0)
    assert play(model, np.full(6000, torque_nm))["theta_x"][-1] == pytest.approx(x, rel=1e-9)


@pytest.mark.parametrize("samples", [0.02, 0.5, 5.0, 99.0, 101.0])
@pytest.mark.parametrize("angle", [0.1, 0.4])
def test_lag_answers_as_the_analogue_lag(samples, angle):
    # the response of the sampled effect, from its answer to a single sample, against 1/(1 + s tau)
    impulse = np.eye(1, 6000)[0]
    effect = make_effect("amplifier-lag", "theta_x", {"time_constant_s": samples * DT_S})
    answer = impulse + along(effect, signal=impulse, dt_s=DT_S)
    got = answer @ np.exp(-1j * angle * np.arange(answer.size))
    # moments up to the third are those of the lag; the fourth is off by less than that of a hold, twice, 2/24
    assert got * (1.0 + 1j * angle * samples) == pytest.approx(1.0, rel=0.0, abs=angle**4 / 12.0)


def test_lag_settles_on_what_it_is_told():
    step = np.ones(4000)
    effect = make_effect("amplifier-lag", "theta_x", {"time_constant_s": 30.0 * DT_S})
    got = step + along(effect, signal=step, dt_s=DT_S)
    # half a sample is held before a mean has risen: between samples 1 - exp(-t / tau), to the size of one difference
    want = -np.expm1(-(np.arange(step.size) + 0.5) / 30.0)
    np.testing.assert_allclose(got, want, rtol=0.0, atol=0.1 / 30.0)


def test_lag_shorter_than_any_sample_is_none():
    effect = make_effect("amplifier-lag", "theta_x", {"time_constant_s": 1e-300})
    np.testing.assert_allclose(along(effect, signal=held_torque(100)), 0.0, rtol=0, atol=1e-290)


def test_delay_equals_a_model_with_that_delay():
    torque = held_torque(400)
    late = play(one_axis([("delay", {"seconds": 1.5e-4})], delay_s=1e-4), torque)["theta_x"]
    np.testing.assert_allclose(late, play(one_axis(delay_s=2.5e-4), torque)["theta_x"], rtol=1e-12, atol=1e-18)
    early = play(one_axis([("delay", {"seconds": -1e-4})], delay_s=2.5e-4), torque)["theta_x"]
    np.testing.assert_allclose(early, play(one_axis(delay_s=1.5e-4), torque)["theta_x"], rtol=1e-12, atol=1e-18)


def test_delay_cannot_become_an_advance():
    with pytest.raises(ConfigError, match="seconds is -0.0002, the model has a delay of 0.0001 s"):
        play(one_axis([("delay", {"seconds": -2e-4})], delay_s=1e-4), held_torque(100))


def test_dead_zone_by_hand():
    u = np.array([-0.3, -0.1, -0.05, 0.0, 0.05, 0.1, 0.3])
    effect = make_effect("dead-zone", "theta_x", {"width": 0.1})
    np.testing.assert_allclose(u + along(effect, signal=u), [-0.2, 0, 0, 0, 0, 0, 0.2], rtol=0, atol=1e-16)


@pytest.mark.parametrize("slug", ["command-quantisation", "sensor-quantisation"])
def test_quantisation_rounds_to_whole_steps(slug):
    q = 0.01
    u = np.random.default_rng(0).uniform(-1, 1, 1000)
    error = along(make_effect(slug, "theta_x", {"step_size": q}), signal=u)
    np.testing.assert_allclose(u + error, q * np.rint(u / q), rtol=0, atol=1e-15)
    # the error is uniform: variance q²/12, here from 1000 draws, whose variance scatters by sqrt(4/5/1000) = 3 %
    assert np.var(error) == pytest.approx(q**2 / 12, rel=5 * 0.03)


@pytest.mark.parametrize("slug", ["command-quantisation", "sensor-quantisation"])
def test_quantisation_far_below_the_rounding_of_the_signal_is_none(slug):
    effect = make_effect(slug, "theta_x", {"step_size": 1e-30})
    np.testing.assert_array_equal(along(effect, signal=np.array([0.0, 1.0, -1e6])), 0.0)


def test_coil_heating_loses_gain_with_the_time_constant():
    n, u, tau, coefficient = 3000, 0.5, 0.05, 0.2
    command = np.concatenate([np.full(n, u), np.zeros(n // 2), np.full(1, u)])
    effect = make_effect("coil-heating", "theta_x", {"coefficient": coefficient, "time_constant_s": tau})
    added = along(effect, signal=command, dt_s=DT_S)
    t = np.arange(n) * DT_S
    np.testing.assert_allclose(added[:n], -coefficient * u**3 * (1 - np.exp(-t / tau)), rtol=0, atol=1e-14)
    left = (1 - np.exp(-n * DT_S / tau)) * np.exp(-(n // 2) * DT_S / tau)
    assert added[-1] == pytest.approx(-coefficient * u**3 * left, rel=1e-10)
