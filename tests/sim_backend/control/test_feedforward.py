"""Feed-forward inputs: they arrive, they are optimal by the conditions of optimality, and their limits hold."""

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

from sim_backend.control.feedforward import (
    least_norm,
    least_peak_within,
    reach_matrix,
    rest_state,
    step_response,
)
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise
from tests.sim_backend.paper_plants import RATE_HZ, theta_x, theta_x_part, theta_y

STEP = 8.5e-3


def _rigid_body(inertia: float) -> ModalModel:
    return ModalModel(
        np.zeros(1), np.zeros(1), np.array([[1 / inertia]]), np.zeros((1, 1)), np.ones((1, 1)),
        np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(1),
    )  # fmt: skip


def _two_by_two() -> ModalModel:
    return ModalModel(
        omega_rad_s=2 * np.pi * np.array([30.0, 35.0, 480.0]),
        sigma_1_s=np.array([5.0, 4.0, 30.0]),
        b=np.array([[3000.0, 100.0], [-200.0, 2500.0], [50.0, 80.0]]),
        b_direct=np.zeros((3, 2)),
        c=np.array([[1.0, 0.1, 1.0], [0.0, 1.0, -1.0]]),
        c_rate=np.zeros((2, 3)),
        d=np.zeros((2, 2)),
        delay_s=np.zeros(2),
    )


@pytest.mark.parametrize("plant", [theta_x_part(), theta_y(), theta_x()], ids=["2nd", "4th", "8th"])
def test_arrives_at_rest_by_an_independent_integration(plant):
    """solve_ivp over the held input, sample by sample, comes to the set point and stays there for 50 ms."""
    move = least_norm(plant, STEP, 50, RATE_HZ)
    a, b, c, _ = plant.state_space()
    omega = np.repeat(np.maximum(plant.omega_rad_s, 1.0), 2)
    omega[0::2] = 1.0  # rates in units of the mode's own frequency
    a, b, c = a * omega[None, :] / omega[:, None], b[:, 0] / omega, c[0] * omega
    x = np.zeros(a.shape[0])
    span = (0.0, 1 / RATE_HZ)
    for u in [*move.drive[:, 0], *np.full(500, move.holding[0])]:
        x = solve_ivp(lambda _, y, u=u: a @ y + b * u, span, x, method="DOP853", rtol=1e-10, atol=1e-14).y[:, -1]
    # 550 steps of relative error 1e-10 on modal motions of up to ten times the step
    assert abs(c @ x - STEP) < 1e-5 * STEP


def test_least_norm_is_the_pseudo_inverse():
    plant = discretise(theta_x_part(), RATE_HZ)
    move = least_norm(theta_x_part(), STEP, 50, RATE_HZ)
    target, _ = rest_state(plant, STEP)
    w = reach_matrix(plant, 50)
    assert np.allclose(w @ move.drive[:, 0], target, rtol=1e-9)
    # optimality: the input lies in the row space of W, so nothing that leaves the end alone can shorten it
    null = np.eye(50) - np.linalg.pinv(w) @ w
    assert np.linalg.norm(null @ move.drive[:, 0]) < 1e-9 * np.linalg.norm(move.drive)


def test_reach_matrix_predicts_the_state():
    plant = discretise(_two_by_two(), RATE_HZ)
    u = np.random.default_rng(3).normal(size=(20, 2))
    x = np.zeros((3, 2))
    for row in u:
        x = np.einsum("mij,mj->mi", plant.a, x) + plant.b @ row
    assert np.allclose(reach_matrix(plant, 20) @ u.reshape(-1), x.reshape(-1), rtol=1e-10)


def test_rigid_body_in_closed_form():
    """A double integrator takes a straight line of zero sum and the wanted first moment; nothing holds it."""
    inertia, n, dt = 3.2e-4, 40, 1 / RATE_HZ
    move = least_norm(_rigid_body(inertia), STEP, n, RATE_HZ)
    lever = n - 0.5 - np.arange(n)
    line = lever - lever.mean()
    expected = line * STEP * inertia / dt**2 / (line @ lever)
    # the states differ by 1/dt in size, so rounding is amplified by up to 1e4
    assert np.allclose(move.drive[:, 0], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    assert abs(move.holding[0]) < 1e-9 * np.abs(expected).max()


def test_two_inputs_move_one_output_and_leave_the_other_at_rest():
    model = _two_by_two()
    move = least_norm(model, [1e-3, 0.0], 50, RATE_HZ)
    response = step_response(discretise(model, RATE_HZ), move, 300)
    assert np.allclose(response[50:], [1e-3, 0.0], atol=1e-12)
    assert np.allclose(model.frequency_response(np.zeros(1))[0].real @ move.holding, [1e-3, 0.0], atol=1e-15)


def test_step_response_equals_scipy():
    model = theta_y()
    move = least_norm(model, STEP, 50, RATE_HZ)
    a, b, c, d = model.state_space()
    system = signal.cont2discrete((a, b, c, d), 1 / RATE_HZ)
    u = np.concatenate([move.drive, np.full((150, 1), move.holding[0])])
    _, reference, _ = signal.dlsim(system, u)
    assert np.allclose(step_response(discretise(model, RATE_HZ), move, 200), reference, atol=1e-12)


@pytest.mark.parametrize("peak", [0.6, 0.5, 0.42, 0.409])
def test_bounded_input_meets_the_conditions_of_optimality(peak):
    """Least norm under |u| <= peak means u = clip(W' l), a combination of the rows of W cut off at the peak."""
    plant = discretise(theta_x_part(), RATE_HZ)
    move = least_norm(theta_x_part(), STEP, 50, RATE_HZ, peak=peak)
    u = move.drive[:, 0]
    assert np.max(np.abs(u)) <= peak
    assert np.allclose(reach_matrix(plant, 50) @ u, rest_state(plant, STEP)[0], rtol=1e-8)
    w = reach_matrix(plant, 50)
    free = np.abs(u) < peak * (1 - 1e-12)
    assert 0 < np.count_nonzero(~free) < 50
    multiplier = np.linalg.lstsq(w[:, free].T, u[free], rcond=None)[0]
    assert np.allclose(np.clip(w.T @ multiplier, -peak, peak), u, atol=1e-8)


def test_a_peak_above_the_free_one_changes_nothing():
    free = least_norm(theta_y(), STEP, 50, RATE_HZ)
    bound = least_norm(theta_y(), STEP, 50, RATE_HZ, peak=1.01 * free.peak)
    assert np.allclose(bound.drive, free.drive, atol=1e-12)


def test_least_peak_within_a_tolerance_keeps_it():
    move = least_peak_within(theta_x(), STEP, 50, 1.7e-6, 300, RATE_HZ)
    response = step_response(discretise(theta_x(), RATE_HZ), move, 2000)[:, 0]
    # the solver's feasibility tolerance is 1e-7 of its scaled rows; 2000 samples of rounding come on top
    assert np.max(np.abs(response[50:] - STEP)) < 1.7e-6 * (1 + 1e-3)
    assert np.max(np.abs(response[300:] - STEP)) < 1e-8
    assert np.abs(response[49] - STEP) > 1.7e-6


def test_a_tolerance_can_only_lower_the_peak():
    exact = least_norm(theta_y(), STEP, 50, RATE_HZ).peak
    peaks = [least_peak_within(theta_y(), STEP, 50, t, 120, RATE_HZ).peak for t in (1e-7, 1.7e-6, 1e-5)]
    assert exact > peaks[0] > peaks[1] > peaks[2]


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: least_norm(theta_x(), STEP, 7, RATE_HZ), "allow 8 samples"),
        (lambda: least_norm(theta_x_part(), STEP, 50, RATE_HZ, peak=0.3), "the limit is 0.3"),
        (lambda: least_norm(_rigid_body(1.0), [1.0], 1, RATE_HZ), "allow 2 samples"),
        (lambda: least_peak_within(theta_y(), STEP, 50, 0.0, 100, RATE_HZ), "tolerance above zero"),
        (lambda: least_peak_within(theta_y(), STEP, 50, 1e-6, 40, RATE_HZ), "arrival <= acting"),
        (
            lambda: rest_state(discretise(_two_by_two().with_(c=np.zeros((2, 3))), RATE_HZ), [1e-3, 0.0]),
            "cannot be held",
        ),
    ],
)
def test_what_cannot_be_is_refused(call, word):
    with pytest.raises(ConfigError, match=word):
        call()
