import numpy as np
import pytest

from analysis.measurements.gaussian import BIN_RAD, gaussian_fit
from sim_backend.errors import DataError


def test_a_gaussian_comes_back_by_both_ways():
    n, sigma = 100_000, 0.55e-6
    x = 0.2e-6 + sigma * np.random.default_rng(9).normal(size=n)
    found = gaussian_fit(x)
    assert found.count.sum() == n
    assert found.centre_rad[np.argmax(found.count)] == pytest.approx(found.mean_rad, abs=2 * BIN_RAD)
    # moments: sigma/sqrt(n) and sigma/sqrt(2 n); the histogram's curve is up to twice as uncertain; four times each
    assert found.moment_mean_rad == pytest.approx(0.2e-6, abs=4 * sigma / np.sqrt(n))
    assert found.moment_sigma_rad == pytest.approx(sigma, rel=4 / np.sqrt(2 * n))
    binned = np.hypot(sigma, BIN_RAD / np.sqrt(12.0))  # what a histogram adds to the width
    assert found.sigma_rad == pytest.approx(binned, rel=8 / np.sqrt(2 * n))
    assert found.peak == pytest.approx(n * BIN_RAD / (binned * np.sqrt(2 * np.pi)), rel=8 / np.sqrt(2 * n))
    assert abs(found.excess_kurtosis) < 4 * np.sqrt(24 / n)
    assert found.curve(np.array([found.mean_rad]))[0] == found.peak


def test_a_curve_that_is_not_gaussian_shows_in_the_kurtosis():
    x = np.random.default_rng(10).uniform(-1e-6, 1e-6, 50_000)
    assert gaussian_fit(x).excess_kurtosis == pytest.approx(-1.2, abs=0.05)  # of a uniform distribution


@pytest.mark.parametrize(("scale", "bin_rad"), [(1e-9, BIN_RAD), (1.0, 1e-9)])
def test_bins_that_do_not_fit_are_refused(scale, bin_rad):
    with pytest.raises(DataError, match="choose a bin width"):
        gaussian_fit(scale * np.linspace(-1.0, 1.0, 100), bin_rad)
