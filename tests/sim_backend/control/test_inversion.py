"""Inversion against simulation by scipy, zeros by python-control, and responses computed from matrices."""

import control
import numpy as np
import pytest
from scipy import signal

from sim_backend.control.feedback import theta_controller
from sim_backend.control.inversion import (
    fitted_inverse,
    inverse_poles,
    periodic_input,
    siso_matrices,
    transmission_zeros,
)
from sim_backend.control.repetitive import process_sensitivity
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise

RATE_HZ = 10_000.0


def plant(delay_s=0.0):
    """A suspension at 30 Hz, a weak mode and a mirror on its support: zeros inside and outside the unit circle."""
    return ModalModel(
        omega_rad_s=2.0 * np.pi * np.array([30.0, 490.0, 1440.0]),
        sigma_1_s=np.array([5.0, 28.0, 34.0]),
        b=np.ones((3, 1)),
        b_direct=np.zeros((3, 1)),
        c=np.array([[3100.0, 150.0, -3250.0]]),
        c_rate=np.zeros((1, 3)),
        d=np.zeros((1, 1)),
        delay_s=np.array([delay_s]),
    )


def simulated(model, drive):
    a, b, c = siso_matrices(discretise(model, RATE_HZ))
    return signal.dlsim((a, b, c, [[0.0]], 1.0 / RATE_HZ), drive)[1][:, 0]


def test_the_periodic_input_holds_the_plant_on_the_motion():
    t = np.arange(2000) / 2000.0
    motion = 1e-3 * (np.sin(2.0 * np.pi * t) + 0.3 * np.cos(6.0 * np.pi * t) + 0.2)
    drive = periodic_input(plant(), motion, RATE_HZ)
    periods = 20
    # the slowest mode decays by exp(-5 · 0.2) per period: 2e-9 of 1 mrad is left after 20
    last = simulated(plant(), np.tile(drive, periods))[-2000:]
    np.testing.assert_allclose(last, motion, atol=1e-3 * np.exp(-5.0 * 0.2 * (periods - 1)))


def test_a_plant_that_does_not_answer_is_refused():
    deaf = plant().with_(c=np.zeros((1, 3)))
    with pytest.raises(ConfigError, match="does not answer"):
        periodic_input(deaf, np.sin(np.arange(100.0)), RATE_HZ)


@pytest.mark.parametrize("delay", [0, 0.4, 1, 2.3, 3])
def test_matrices_answer_as_the_plant_does(delay):
    model = discretise(plant(delay / RATE_HZ), RATE_HZ)
    f = np.array([1.0, 29.0, 480.0, 1500.0, 4900.0])
    system = control.ss(*siso_matrices(model), [[0.0]], 1.0 / RATE_HZ)
    ours = system(np.exp(2j * np.pi * f / RATE_HZ))
    np.testing.assert_allclose(ours, model.frequency_response(f)[:, 0, 0], rtol=1e-9)


def test_a_feedthrough_is_refused_unless_it_is_late():
    with pytest.raises(ConfigError, match="feedthrough"):
        siso_matrices(discretise(plant().with_(d=np.ones((1, 1))), RATE_HZ))
    late = discretise(plant(2.0 / RATE_HZ).with_(d=np.full((1, 1), 0.02)), RATE_HZ)
    f = np.array([1.0, 480.0, 4900.0])
    system = control.ss(*siso_matrices(late), [[0.0]], 1.0 / RATE_HZ)
    ours = system(np.exp(2j * np.pi * f / RATE_HZ))
    np.testing.assert_allclose(ours, late.frequency_response(f)[:, 0, 0], rtol=1e-9)


def test_zeros_are_those_of_the_numerator():
    a, b, c = siso_matrices(discretise(plant(), RATE_HZ))
    # the matrix determinant lemma: numerator = det(zI - A + b c) - det(zI - A)
    numerator = np.poly(a - b @ c) - np.poly(a)
    zeros = transmission_zeros(discretise(plant(), RATE_HZ))
    assert zeros.size == 5  # six states, one sample of delay
    assert np.any(np.abs(zeros) > 1.0)  # sampling four more poles than zeros puts one there
    for zero in zeros:
        size = float(np.polyval(np.abs(numerator), abs(zero)))
        # coefficients cancel to eps of the largest, some 20
        assert abs(np.polyval(numerator, zero)) < 1e-9 * max(size, 20.0)


def test_the_learning_filter_inverts_the_closed_loop():
    model, feedback = discretise(plant(), RATE_HZ), theta_controller()
    f = np.geomspace(2.0, 4900.0, 3000)
    closed = process_sensitivity(model.frequency_response(f)[:, 0, 0], feedback.frequency_response(f))
    weight = np.where(f < 1500.0, 1.0, 0.01)
    made = fitted_inverse(f, closed, weight, inverse_poles(model, feedback), 10, RATE_HZ)
    assert np.max(np.abs(made.poles())) < 1.0
    # another grid than the fit's, and the closed loop by python-control
    at = np.linspace(20.0, 1400.0, 777)
    z = np.exp(2j * np.pi * at / RATE_HZ)
    p = control.ss(*siso_matrices(model), [[0.0]], 1.0 / RATE_HZ)
    c = control.ss(*feedback.state_space(), 1.0 / RATE_HZ)
    left = np.abs(1.0 - z**10 * (p(z) / (1.0 + p(z) * c(z))) * made.frequency_response(at))
    # a causal filter with ten samples of lead leaves what the inverse of a zero at -9 looks ahead: 9^-10; the rest is
    # the weight that is given up above 1500 Hz
    assert np.max(left) < 0.02


def test_without_lead_the_inverse_cannot_be_causal():
    model, feedback = discretise(plant(), RATE_HZ), theta_controller()
    f = np.geomspace(2.0, 4900.0, 1000)
    closed = process_sensitivity(model.frequency_response(f)[:, 0, 0], feedback.frequency_response(f))
    made = fitted_inverse(f, closed, np.ones(f.size), inverse_poles(model, feedback), 0, RATE_HZ)
    assert np.max(np.abs(1.0 - closed * made.frequency_response(f))) > 0.1


def test_a_filter_for_several_plants_leaves_least_on_all_of_them_together():
    """No other numerators over the same poles leave less: the error is at right angles to every column."""
    model, feedback, f = discretise(plant(), RATE_HZ), theta_controller(), np.geomspace(2.0, 4900.0, 800)
    one = process_sensitivity(model.frequency_response(f)[:, 0, 0], feedback.frequency_response(f))
    z = np.exp(2j * np.pi * f / RATE_HZ)
    closed = np.stack([one, 1.3 * one * z**-0.4, 0.8 * one * z**-1.2])
    weight, pole = np.where(f < 1500.0, 1.0, 0.01), 0.6 * np.exp(0.9j)
    made = fitted_inverse(f, closed, weight, [pole, 0.5 + 0.0j], 3, RATE_HZ)
    left = weight * (z**3 * closed * made.frequency_response(f) - 1.0)
    pair = 1.0 / ((z - pole) * (z - pole.conjugate()))
    for column in (np.ones_like(z), pair, z * pair, 1.0 / (z - 0.5)):
        moved = weight * z**3 * closed * column
        along = np.vdot(moved, left).real
        assert abs(along) < 1e-9 * np.linalg.norm(moved) * np.linalg.norm(left)
    assert np.linalg.norm(left) < 0.9 * np.linalg.norm(np.broadcast_to(weight, closed.shape))


def test_a_frequency_at_which_no_plant_answers_decides_nothing():
    model, feedback, f = discretise(plant(), RATE_HZ), theta_controller(), np.geomspace(2.0, 4900.0, 300)
    closed = process_sensitivity(model.frequency_response(f)[:, 0, 0], feedback.frequency_response(f))
    poles, without = inverse_poles(model, feedback), np.arange(f.size) != 7
    silent = np.where(without, closed, 0.0)
    made = [fitted_inverse(f[k], silent[k], np.ones(k.sum()), poles, 10, RATE_HZ) for k in (without, without | True)]
    first, second = (one.frequency_response(f) for one in made)
    np.testing.assert_allclose(first, second, rtol=1e-9)


def test_a_learning_filter_that_grows_is_refused():
    with pytest.raises(ConfigError, match="inside the unit circle"):
        fitted_inverse([1.0, 2.0], [1.0, 1.0], [1.0, 1.0], [1.01 + 0.0j], 1, RATE_HZ)
    with pytest.raises(ConfigError, match="lead -1"):
        fitted_inverse([1.0, 2.0], [1.0, 1.0], [1.0, 1.0], [0.5 + 0.0j], -1, RATE_HZ)
