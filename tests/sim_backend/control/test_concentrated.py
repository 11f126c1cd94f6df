"""The concentrated move against the eigenvalue problem that defines it, and against other windows."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.signal.windows import hann

from sim_backend.control.concentrated import arrival_sample, bandwidth_hz, concentrated_move
from sim_backend.errors import ConfigError

N, C = 48, 3.0


def within(velocity, half_band):
    """Part of the energy of a sequence below `half_band` cycles per sample, from its own quadratic form."""
    lag = np.subtract.outer(np.arange(velocity.size), np.arange(velocity.size))
    kernel = 2.0 * half_band * np.sinc(2.0 * half_band * lag)
    return velocity @ kernel @ velocity / (velocity @ velocity)


def test_it_goes_from_zero_to_one_without_turning_back():
    move = concentrated_move(N, C)
    assert move.shape == (N + 1,)
    assert move[0] == 0.0 and move[-1] == pytest.approx(1.0, abs=1e-15)
    assert np.all(np.diff(move) > 0.0)


def test_no_other_move_of_its_length_is_as_concentrated():
    lag = np.subtract.outer(np.arange(N), np.arange(N))
    best = eigh(2.0 * C / N * np.sinc(2.0 * C / N * lag), eigvals_only=True)[-1]
    ours = within(np.diff(concentrated_move(N, C)), C / N)
    # 1 - best is 2e-7: compared as what lies outside, to the rounding of 48 terms
    assert 1.0 - ours == pytest.approx(1.0 - best, rel=1e-6)
    assert 1.0 - within(hann(N + 2)[1:-1], C / N) > 10.0 * (1.0 - ours)


def test_its_bandwidth_is_that_of_the_eigenvalue_problem():
    assert bandwidth_hz(N, C, 1e4) == pytest.approx(625.0)


def test_it_arrives_where_the_rest_of_the_way_is_within_the_tolerance():
    move = concentrated_move(N, C)
    first = arrival_sample(move, 8.5e-3, 1.7e-6)
    assert np.all(8.5e-3 * (1.0 - move[first:]) <= 1.7e-6)
    assert 8.5e-3 * (1.0 - move[first - 1]) > 1.7e-6
    assert arrival_sample(move, -8.5e-3, 1.7e-6) == first
    assert arrival_sample(move, 1e-9, 1.7e-6) == 0


@pytest.mark.parametrize(("n", "c"), [(3, 1.0), (48, 0.5), (48, 12.0), (48, float("nan"))])
def test_what_is_no_move_is_refused(n, c):
    with pytest.raises(ConfigError, match="concentration"):
        concentrated_move(n, c)
