"""The unknown state in which a record starts, against the matrix exponential."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from analysis.diagnosis.fitting.starts import stack_white, start_of, without_starts
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from sim_backend.assembly import places_of, transducers_of
from sim_backend.linear import played
from sim_backend.replay import replay
from tests.analysis.diagnosis.two_modes import RATE_HZ, drive, linear_model, one_axis


def test_start_states_are_recovered_and_projected_out() -> None:
    linear, u = linear_model(), drive(800)
    states = np.array([[1e-3, 0.05], [2e-4, -0.1]])
    moved, still = (
        replay(linear, [], places_of(one_axis()), transducers_of(one_axis()), u, RATE_HZ, start=x)
        for x in (states, np.zeros((2, 2)))
    )
    y = moved.position - still.position
    # the free response itself, against the matrix exponential
    a, _, c, _ = linear.state_space()
    expected = [(c @ expm(a * k / RATE_HZ) @ states.reshape(-1))[0] for k in (0, 7, 300)]
    np.testing.assert_allclose(y[[0, 7, 300], 0], expected, rtol=1e-9)
    record = Record("r", u, y, (Window("all", 0, 800),))
    whitener = Whitener(np.array([[1e6]]), True)
    start = start_of(record, linear, whitener, RATE_HZ)
    white = stack_white(whitener, record, y[:, :, None])[:, 0]
    np.testing.assert_allclose(start.states(white), states, rtol=1e-6)
    assert np.linalg.norm(start.project(white)) < 1e-9 * np.linalg.norm(white)


def test_a_start_that_is_forgotten_before_the_fitted_rows_is_not_made_of_their_rounding() -> None:
    linear, u = linear_model(), drive(8000)
    y = 1e-3 * np.random.default_rng(1).standard_normal((8000, 1))
    whitener = Whitener(np.array([[1e6]]), True)
    late = Record("r", u, y, (Window("late", 7000, 8000),))  # after 17 times the memory of the slowest mode
    start = start_of(late, linear, whitener, RATE_HZ)
    white = stack_white(whitener, late, y[:, :, None])[:, 0]
    assert np.all(start.states(white) == 0.0)
    np.testing.assert_array_equal(start.project(white), white)


@pytest.mark.parametrize("late", [2.0, 1.3])
def test_commands_from_before_a_record_are_part_of_its_start(late: float) -> None:
    linear = linear_model().with_(delay_s=np.array([late / RATE_HZ]))
    u = drive(1000)
    # the reading of a longer record, of which the last rows are one by themselves
    y = simulate(played(linear, RATE_HZ), u)[200:]
    record = Record("r", u[200:], y, (Window("all", 0, 800),))
    data = Dataset(RATE_HZ, (record,))
    left = y - simulate(played(linear, RATE_HZ), record.u)
    (rest,) = without_starts(data, linear, Whitener(np.array([[1e6]]), True), [left])
    assert np.max(np.abs(rest)) < 1e-9 * np.max(np.abs(left))


def test_the_zero_of_a_free_axis_is_no_more_than_where_it_begins() -> None:
    """A free axis may rest anywhere: beside that its zero adds nothing, and is not made of rounding."""
    one = linear_model()
    free = one.with_(omega_rad_s=np.zeros_like(one.omega_rad_s), sigma_1_s=np.full_like(one.sigma_1_s, 0.35))
    data = Dataset(RATE_HZ, (Record("r", drive(800), np.zeros((800, 1)), (Window("all", 0, 800),), free_zeros=(0,)),))
    offset = np.full((800, 1), 1e-3)
    (rest,) = without_starts(data, free, Whitener(np.array([[1e6]]), True), [offset])
    assert np.max(np.abs(rest)) < 1e-9 * np.max(np.abs(offset))
