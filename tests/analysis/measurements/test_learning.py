import numpy as np
import pytest

from analysis.measurements.learning import learning_curve
from sim_backend.errors import DataError


def test_a_geometric_fall_converges_where_it_meets_the_tolerance():
    rate, floor = 0.5, 1.0
    rms = floor + 1000.0 * rate ** np.arange(40)
    found = learning_curve(rms[:, None] * np.ones(10))
    # 1000 · 0.5^k <= 0.1 for k >= 13.3, so index 14: the fifteenth period
    assert found.converged_at == 15
    assert found.floor == pytest.approx(floor, rel=1e-3)
    np.testing.assert_allclose(found.rms, rms)


def test_an_error_that_still_falls_at_the_end_has_not_converged():
    assert learning_curve(2.0 ** -np.arange(40.0)[:, None] * np.ones(10)).converged_at is None


def test_a_level_error_was_converged_from_the_start():
    assert learning_curve(np.ones((20, 10))).converged_at == 1


def test_noise_about_the_floor_neither_hides_convergence_nor_counts_as_a_fall():
    rng = np.random.default_rng(1)
    fall = 6000.0 * 0.55 ** np.arange(24)
    found = [learning_curve((fall + 8.0 * rng.uniform(0.5, 1.5, 24))[:, None] * np.ones(4)) for _ in range(200)]
    at = np.array([np.nan if f.converged_at is None else f.converged_at for f in found])
    # the fall meets the noise, 4 to 12, between its 11th and 13th period; six periods decide what the noise is
    assert 10 <= np.nanmedian(at) <= 13
    assert np.mean(np.isnan(at)) < 0.1


def test_too_few_periods():
    with pytest.raises(DataError, match="12 or more"):
        learning_curve(np.ones((11, 10)))
