import numpy as np
import pytest

from analysis.measurements.thermal import compare_sweeps, drift
from sim_backend.errors import DataError

TIME_S = 0.1 + 0.2 * np.arange(1500)


def test_a_known_drift_is_found_and_no_drift_is_not():
    rng = np.random.default_rng(11)
    noise = 2e-7 * rng.normal(size=(1500, 2))
    noise[:, 0] += 5e-7 * TIME_S / 300.0
    found = drift(TIME_S, noise)
    assert found.total_rad[0] == pytest.approx(5e-7, abs=2.0 * found.half_width_rad[0])
    assert found.significant[0]
    assert found.half_width_rad[1] == pytest.approx(1.96 * 2e-7 * np.sqrt(12.0 / 1500), rel=0.1)  # white: closed form


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_the_interval_covers_zero_95_times_in_100(correlation):
    rng = np.random.default_rng(12)
    white = rng.normal(size=(300, 400))
    noise = np.empty_like(white)
    noise[0] = white[0] / np.sqrt(1 - correlation**2)
    for k in range(1, 300):
        noise[k] = correlation * noise[k - 1] + white[k]
    missed = drift(np.arange(300.0), noise).significant.sum()
    # binomial, 400 trials at 5 %: mean 20, deviation 4.4; the effective number is itself an estimate, so up to 8 % pass
    assert 5 <= missed <= 45


def test_equal_sweeps_differ_by_noise_only_and_a_shift_stands_out():
    rng = np.random.default_rng(13)
    f = np.arange(5.0, 105.0, 5.0)
    g = 0.09 / (1.0 - (f / 29.56) ** 2 + 0.02j * f / 29.56)
    std = np.full(f.size, 1e-3)

    def measured(response):
        return np.abs(response) * (1.0 + std * rng.normal(size=f.size))

    same = compare_sweeps(f, measured(g), measured(g), std, std)
    assert 1e-4 < same.p_value and same.chi2_per_point < 3.0  # 20 points: 3.0 is beyond one in 10 000
    moved = 0.09 / (1.0 - (f / 29.7) ** 2 + 0.02j * f / 29.7)
    other = compare_sweeps(f, measured(g), measured(moved), std, std)
    assert other.p_value < 1e-6
    assert other.largest_hz == 30.0
    np.testing.assert_allclose(same.std_db, 20 * np.log10(np.e) * np.sqrt(2) * 1e-3)


def test_bad_input_is_refused():
    with pytest.raises(DataError, match="one rising time"):
        drift(np.zeros(10), np.zeros((10, 1)))
    with pytest.raises(DataError, match="magnitudes above zero"):
        compare_sweeps([5.0, 10.0], [1.0, 0.0], [1.0, 1.0], [0.1, 0.1], [0.1, 0.1])
