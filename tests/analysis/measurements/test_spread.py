import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.measurements.spread import detrended, spread
from sim_backend.errors import DataError


def test_a_straight_line_is_taken_out_exactly():
    t = np.arange(50.0)
    y, slope = detrended(np.stack([3.0 + 2.0 * t, -1.0 - 0.5 * t], axis=1))
    np.testing.assert_allclose(slope, [2.0, -0.5], rtol=1e-13)  # rounding of sums over 50 terms
    np.testing.assert_allclose(y, 0.0, atol=1e-12)


def test_slope_and_scatter_equal_a_regression_by_numpy():
    rng = np.random.default_rng(1)
    y = rng.normal(size=400) + 0.01 * np.arange(400)
    line = np.polyfit(np.arange(400), y, 1)
    expected = np.sqrt(np.sum((y - np.polyval(line, np.arange(400))) ** 2) / 398)
    found = spread(y[:, None])
    assert found.slope[0] == pytest.approx(line[0], rel=1e-9)
    assert found.std[0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("pole", [0.0, 0.9])
def test_the_uncertainty_is_right_for_white_and_coloured_noise(pole):
    rng = np.random.default_rng(2)
    noise = lfilter([1.0], [1.0, -pole], rng.normal(size=(2000, 400)), axis=0)[500:]
    found = spread(noise)
    # the scatter of 400 estimates is itself known to 1/sqrt(2·400) = 3.5 %; four times that is 14 %
    assert np.mean(found.std_error) == pytest.approx(np.std(found.std), rel=0.14)


def test_two_samples_hold_no_scatter():
    with pytest.raises(DataError, match="3 or more"):
        spread(np.zeros((2, 1)))
