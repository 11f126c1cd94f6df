"""Linear responses, against the discretisation of scipy."""

from __future__ import annotations

import numpy as np
from scipy.signal import cont2discrete, dlsim

from analysis.diagnosis.nominal.responses import coasting, contrast, free_responses, simulate
from sim_backend.linear import discretise
from tests.analysis.diagnosis.two_modes import RATE_HZ, drive, linear_model


def test_simulation_is_the_exact_hold_of_scipy() -> None:
    linear, u = linear_model(), drive(500)
    a, b, c, d = linear.state_space()
    system = cont2discrete((a, b, c, d), 1 / RATE_HZ)
    _, expected, _ = dlsim(system, u)
    np.testing.assert_allclose(simulate(discretise(linear, RATE_HZ), u), expected, rtol=0, atol=1e-12)


def test_free_responses_span_every_start() -> None:
    free = free_responses(discretise(linear_model(), RATE_HZ), 50)
    assert free.shape == (50, 1, 4)
    assert np.linalg.matrix_rank(free[:, 0]) == 4


def test_a_start_swings_on_as_scipy_says() -> None:
    linear, start = linear_model(), np.array([[0.3, -20.0], [0.01, 5.0]])
    a, b, c, d = linear.state_space()
    still = np.zeros((400, linear.n_inputs))
    _, expected, _ = dlsim(cont2discrete((a, b, c, d), 1 / RATE_HZ), still, x0=start.ravel())
    model = discretise(linear, RATE_HZ)
    np.testing.assert_allclose(coasting(model, start, 400), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(free_responses(model, 400) @ start.ravel(), expected, rtol=0, atol=1e-12)


def test_contrast_is_the_difference_of_two_responses() -> None:
    linear, u, start = linear_model(), drive(400), np.array([0.3, -20.0])
    first = linear.only(np.array([True, False])).with_(d=np.zeros_like(linear.d))
    there, back = discretise(first, RATE_HZ), discretise(first.with_(omega_rad_s=1.01 * first.omega_rad_s), RATE_HZ)
    expected = simulate(there, u, through_delay=False) - simulate(back, u, through_delay=False)
    expected += coasting(there, start[None], 400) - coasting(back, start[None], 400)
    np.testing.assert_allclose(contrast(there, back, u, start), expected, rtol=0, atol=1e-12)
