import numpy as np
import pytest

from analysis.measurements.reproducibility import reproducibility
from sim_backend.errors import DataError


def test_scatter_of_step_and_integration_are_told_apart():
    rng = np.random.default_rng(14)
    in_step = np.arange(1000) < 50
    sigma = np.where(in_step, 3e-6, 0.5e-6)
    cycles = 8e-3 + sigma * rng.normal(size=(200, 1000))
    found = reproducibility(cycles, in_step)
    # pooled over 200·50 and 200·950 deviations: known to 1/sqrt(2·10 000) = 0.7 % and less; four times that
    assert found.step == pytest.approx(9e-6, rel=0.03)
    assert found.integration == pytest.approx(1.5e-6, rel=0.01)
    assert found.step_largest == np.max(np.abs(cycles - cycles.mean(axis=0))[:, in_step])
    assert found.integration_largest > found.integration
    np.testing.assert_allclose(found.three_sigma, 3.0 * cycles.std(axis=0, ddof=1), rtol=1e-12)


def test_equal_cycles_reproduce_exactly():
    found = reproducibility(np.tile(np.sin(np.arange(100.0)), (5, 1)), np.arange(100) < 3)
    assert max(found.step, found.integration) < 1e-14  # rounding of the mean of numbers about 1


@pytest.mark.parametrize(
    ("cycles", "marked"), [(np.zeros((5, 10)), np.zeros(10)), (np.zeros((5, 10)), np.ones(10)), (np.zeros((2, 10)), [])]
)
def test_bad_input_is_refused(cycles, marked):
    with pytest.raises(DataError, match="reproducibility"):
        reproducibility(cycles, marked)
