"""Linear responses, against the discretisation of scipy."""

from __future__ import annotations

import numpy as np
from scipy.signal import cont2discrete, dlsim

from analysis.diagnosis.nominal.responses import free_responses, simulate
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
