"""Least-variance feedback against Riccati equations solved by iteration, and variances by Lyapunov's equation."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from sim_backend.control.feedback import closed_loop_poles, theta_controller
from sim_backend.control.inversion import siso_matrices
from sim_backend.control.lqg import DRIFT, LinearQuadraticGaussian, Noise, least_reading_rad, reading_spectrum
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise

RATE_HZ = 10_000.0
NOISE = Noise(3.4e-5, 50.0, 1.1e-7)


def plant():
    return ModalModel(
        omega_rad_s=2.0 * np.pi * np.array([30.0, 1440.0]),
        sigma_1_s=np.array([5.0, 34.0]),
        b=np.ones((2, 1)),
        b_direct=np.zeros((2, 1)),
        c=np.array([[3100.0, -3250.0]]),
        c_rate=np.zeros((1, 2)),
        d=np.zeros((1, 1)),
        delay_s=np.zeros(1),
    )


def augmented(distrust):
    a, b, c = siso_matrices(discretise(plant(), RATE_HZ))
    n, forget = 4, np.exp(-2.0 * np.pi * 50.0 / RATE_HZ)
    whole = np.block([[a, b, b], [np.zeros((1, n)), forget, 0.0], [np.zeros((1, n)), 0.0, 1.0]])
    driven = np.diag([0.0] * n + [NOISE.torque_nm**2 * (1.0 - forget**2), (DRIFT * NOISE.torque_nm) ** 2])
    driven[:n, :n] = (distrust * NOISE.torque_nm) ** 2 * b @ b.T
    return a, b, c, whole, driven


def frequencies():
    """Midpoints of 0.05 Hz up to half the rate: fine enough for the slowest mode of all loops here."""
    return (np.arange(100_000) + 0.5) * 0.05


@pytest.mark.parametrize(("effort", "distrust"), [(1e-3, 0.0), (3e-3, 10.0)])
def test_it_is_the_regulator_and_the_estimator_that_solve_their_riccati_equations(effort, distrust):
    a, b, c, whole, driven = augmented(distrust)
    # fixed points by plain iteration, which needs no factorisation of badly scaled pencils
    seen, unit = np.hstack([c, np.zeros((1, 2))]), NOISE.reading_rad**2
    spread, cost = driven.copy(), c.T @ c
    for _ in range(20_000):
        ahead = whole @ spread
        spread = ahead @ whole.T - ahead @ seen.T @ (seen @ ahead.T) / (seen @ spread @ seen.T + unit) + driven
        back = a.T @ cost
        cost = back @ a - back @ b @ (b.T @ back.T) / (b.T @ cost @ b + effort**2) + c.T @ c
    blend = spread @ seen.T / (seen @ spread @ seen.T + unit)
    full = np.hstack([b.T @ cost @ a / (b.T @ cost @ b + effort**2), np.ones((1, 2))])
    forward = (whole - np.vstack([b, np.zeros((2, 1))]) @ full) @ (np.eye(6) - blend @ seen)
    f = np.geomspace(1.0, 4900.0, 200)
    ours = LinearQuadraticGaussian(plant(), NOISE, RATE_HZ).controller(effort, distrust).frequency_response(f)
    wanted = []
    for x in np.exp(2j * np.pi * f / RATE_HZ):
        # the estimator in its own words: predict from the last estimate, correct with the reading, regulate
        predicted = np.linalg.solve(x * np.eye(6) - forward, (whole - np.vstack([b, np.zeros((2, 1))]) @ full) @ blend)
        wanted.append((full @ ((np.eye(6) - blend @ seen) @ predicted + blend))[0, 0])
    # the error of the iteration falls by the square of the slowest closed-loop pole, 0.995 at most, per step
    np.testing.assert_allclose(ours, wanted, rtol=1e-5)


def test_it_integrates_and_its_loop_is_stable():
    made = LinearQuadraticGaussian(plant(), NOISE, RATE_HZ).controller(3e-3, 10.0)
    assert made.integrator == 0
    assert np.max(np.abs(closed_loop_poles(discretise(plant(), RATE_HZ), made))) < 1.0


def variance_by_lyapunov(controller):
    """Variance of the reading of the closed loop driven by both noises, from its state space."""
    a, b, c = siso_matrices(discretise(plant(), RATE_HZ))
    ac, bc, cc, dc = controller.state_space()
    n, m, forget = a.shape[0], ac.shape[0], NOISE.forget(RATE_HZ)
    # states: plant, controller, disturbance; the error is -(c x + v)
    whole = np.block(
        [
            [a - b @ dc @ c, b @ cc, b],
            [-bc @ c, ac, np.zeros((m, 1))],
            [np.zeros((1, n + m)), np.array([[forget]])],
        ]
    )
    by_reading = np.vstack([-b @ dc, -bc, [[0.0]]]) * NOISE.reading_rad
    by_torque = np.zeros((n + m + 1, 1))
    by_torque[-1, 0] = NOISE.torque_nm * np.sqrt(1.0 - forget**2)
    spread = solve_discrete_lyapunov(whole, by_reading @ by_reading.T + by_torque @ by_torque.T)
    return float((c @ spread[:n, :n] @ c.T)[0, 0] + NOISE.reading_rad**2)


@pytest.mark.parametrize(
    "made",
    [theta_controller(), LinearQuadraticGaussian(plant(), NOISE, RATE_HZ).controller(1e-3, 3.0)],
    ids=["paper", "ours"],
)
def test_the_spectrum_holds_the_variance_that_lyapunov_gives(made):
    f = frequencies()
    p = discretise(plant(), RATE_HZ).frequency_response(f)[:, 0, 0]
    parts = reading_spectrum(f, p, made.frequency_response(f), NOISE, RATE_HZ)
    # midpoints against modes of 1 Hz width: the rule's error falls exponentially, rounding of the equation remains
    assert float(np.mean(parts[0] + parts[1])) == pytest.approx(variance_by_lyapunov(made), rel=1e-5)


def test_its_variance_is_least_without_effort_and_doubt():
    best = variance_by_lyapunov(LinearQuadraticGaussian(plant(), NOISE, RATE_HZ).controller(1e-4, 0.0))
    assert best < variance_by_lyapunov(theta_controller())
    for factor in (0.8, 1.2):
        assert (
            variance_by_lyapunov(LinearQuadraticGaussian(plant(), NOISE, RATE_HZ).controller(1e-4, 0.0).scaled(factor))
            > best
        )


def test_the_bound_is_szegos():
    f = frequencies()
    p = discretise(plant(), RATE_HZ).frequency_response(f)[:, 0, 0]
    spectrum = sum(reading_spectrum(f, p, np.zeros(f.size), NOISE, RATE_HZ))  # loops open
    # the variance of what cannot be predicted is the geometric mean of the spectrum (Szegő, Kolmogorov)
    szego = np.sqrt(np.exp(np.mean(np.log(spectrum))))
    # the drift without which the equation has a pole on the circle is 1e-5 of the disturbance
    assert least_reading_rad(plant(), NOISE, RATE_HZ) == pytest.approx(szego, rel=1e-4)


@pytest.mark.parametrize("effort", [1e-4, 1e-3])
def test_no_feedback_comes_below_the_bound(effort):
    made = LinearQuadraticGaussian(plant(), NOISE, RATE_HZ).controller(effort, 0.0)
    assert np.sqrt(variance_by_lyapunov(made)) > least_reading_rad(plant(), NOISE, RATE_HZ) > NOISE.reading_rad


def test_less_effort_and_more_doubt_cost_variance():
    f = frequencies()
    p = discretise(plant(), RATE_HZ).frequency_response(f)[:, 0, 0]

    def variance(effort, distrust):
        k = LinearQuadraticGaussian(plant(), NOISE, RATE_HZ).controller(effort, distrust).frequency_response(f)
        return np.mean(sum(reading_spectrum(f, p, k, NOISE, RATE_HZ)))

    assert variance(1e-4, 0.0) < variance(1e-3, 0.0) < variance(1e-2, 0.0)
    assert variance(1e-4, 0.0) < variance(1e-4, 30.0)


@pytest.mark.parametrize("change", [{"torque_nm": 0.0}, {"bandwidth_hz": -1.0}, {"reading_rad": float("nan")}])
def test_noise_is_above_zero(change):
    with pytest.raises(ConfigError, match=next(iter(change))):
        Noise(**{**vars(NOISE), **change})
