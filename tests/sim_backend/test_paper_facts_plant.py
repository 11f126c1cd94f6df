"""What the printed plants say, recomputed from the coefficients of Table 6.2."""

import numpy as np
import pytest
from scipy import signal

from sim_backend.control.feedforward import StepInput, step_response
from sim_backend.kinematics import load_to_forces
from sim_backend.linear import discretise
from sim_backend.polynomial import scaled_roots
from tests.sim_backend.paper_plants import (
    RATE_HZ,
    STATIC_GAIN,
    THETA_X_DEN,
    THETA_X_NUM,
    theta_x,
    theta_x_printed,
    theta_y,
    z_axis,
)


def _hz(roots):
    return np.sort(np.abs(roots[roots.imag > 0])) / (2 * np.pi)


def _static(model):
    return model.frequency_response(np.zeros(1))[0, 0, 0].real


def test_angles_are_milliradian_per_newton_metre():
    """0.05 N m corresponds to 4.5 mrad and 0.08 N m to 7.2 mrad (Fig. 6.7), within the two printed digits."""
    assert np.isclose(_static(theta_x_printed()), 89.6e-3, atol=0.05e-3)
    assert np.isclose(0.05 * _static(theta_x_printed()), 4.5e-3, atol=0.05e-3)
    assert np.isclose(0.08 * _static(theta_x_printed()), 7.2e-3, atol=0.05e-3)


def test_poles_and_zeros_of_theta_x():
    assert np.allclose(_hz(scaled_roots(THETA_X_DEN)), [29.56, 123.25, 489.5, 1999.9], atol=0.05)
    assert np.allclose(_hz(scaled_roots(THETA_X_NUM)), [122.9, 479.8], atol=0.05)


def test_printed_high_mode_contradicts_the_text():
    """Text and Table 6.1: 1440 Hz. The three digits of each coefficient cannot move it from 2000 Hz that far.

    The sum of all poles' squared moduli is fixed by b6 = 1.68e8, 0.3 % at most; the highest mode carries 93 %
    of it.
    """
    rng = np.random.default_rng(6)
    half_units = np.array([0, 0.05, 5e5, 5e7, 5e12, 5e13, 5e17, 5e18, 5e22])
    highest = [_hz(scaled_roots(THETA_X_DEN + half_units * rng.uniform(-1, 1, 9)))[-1] for _ in range(200)]
    assert 1900 < min(highest)
    assert max(highest) < 2100


def test_stiffness_and_inertia_of_theta_x():
    stiffness = 1 / STATIC_GAIN
    assert np.isclose(stiffness, 11.16, atol=0.005)
    assert np.isclose(stiffness / theta_x_printed().omega_rad_s[0] ** 2, 3.23e-4, atol=0.005e-4)


def test_theta_y_agrees_with_the_text():
    assert np.allclose(theta_y().omega_rad_s / (2 * np.pi), [29.22, 1440.0], atol=0.05)
    assert np.isclose(theta_y().sigma_1_s[1], 34.0, atol=0.5)


def test_z_axis_as_millimetre_per_newton_would_weigh_a_tenth_of_a_kilogram():
    omega, sigma = z_axis().omega_rad_s[0], z_axis().sigma_1_s[0]
    assert np.isclose(omega / (2 * np.pi), 20.07, atol=0.005)
    assert np.isclose(sigma / omega, 0.042, atol=0.0005)
    assert np.isclose(_static(z_axis()), 0.635e-3, atol=0.0005e-3)
    assert np.isclose(1 / z_axis().c[0, 0], 0.099, atol=0.0005)


@pytest.mark.parametrize("model", [theta_x(), theta_x_printed()], ids=["1440 Hz", "as printed"])
def test_moving_the_high_mode_keeps_what_lies_below(model):
    """Same gain at 0 Hz by construction; below 600 Hz they differ by the high mode's share (f/1440)² at most."""
    f = np.geomspace(1.0, 600.0, 200)
    ratio = np.abs(model.frequency_response(f) / theta_x_printed().frequency_response(f))[:, 0, 0]
    bound = (1 - (f / 2000) ** 2) / (1 - (f / 1440) ** 2)
    assert np.isclose(_static(model), STATIC_GAIN, rtol=1e-12)
    assert np.all(ratio >= 1 - 1e-4)
    assert np.all(ratio <= bound * (1 + 1e-4))


def test_leaving_out_the_hold_costs_nine_per_mille_at_the_resonance():
    """A hold is half a sample of delay and a sinc: |exp(-j pi f T) sinc(f T) - 1| = pi f T = 0.93 % at 29.56 Hz."""
    f = np.array([29.56])
    error = abs(theta_x().frequency_response(f, RATE_HZ) / theta_x().frequency_response(f) - 1)[0, 0, 0]
    assert np.isclose(error, np.pi * f[0] / RATE_HZ, rtol=1e-3)
    assert np.isclose(error, 0.009, atol=0.0005)


def test_the_eighth_order_polynomial_loses_digits_in_companion_form_but_does_not_overflow():
    """The printed polynomial, discretised whole, is still right to six digits.

    Its step response by an exponential of the companion matrix keeps 1e-14 in scipy's lsim, 1e-6 in
    cont2discrete.
    """
    plant, n = theta_x_printed(), 2000
    hold = StepInput(np.ones((1, 1)), np.ones(1), np.array([STATIC_GAIN]), 1, RATE_HZ)
    ours = step_response(discretise(plant, RATE_HZ), hold, n)[:, 0]
    system = (np.array(THETA_X_NUM) * 1e-3, THETA_X_DEN)
    _, whole, _ = signal.lsim(system, np.ones(n), np.arange(n) / RATE_HZ)
    assert np.allclose(ours, whole, rtol=0.0, atol=1e-12)
    b, a, _ = signal.cont2discrete(system, 1 / RATE_HZ)
    error = np.max(np.abs(signal.lfilter(b[0], a, np.ones(n)) - ours)) / np.max(ours)
    assert 1e-8 < error < 1e-5


def test_radius_of_the_actuators_from_the_printed_peak_current():
    """2.75 A at 5.7 N/A carries the peak torque of the 2nd-order feed-forward, 0.6275 N m, at 26.7 mm."""
    force_at_1_m = np.abs(load_to_forces(np.array([0.6275, 0.0, 0.0]), 1.0)).max()
    assert np.isclose(force_at_1_m / (2.75 * 5.7), 0.0267, atol=0.00005)
