import numpy as np
import pytest

from analysis.measurements.chop import chop_stability, observation_windows, offsets
from sim_backend.errors import DataError

SIGMA = 0.6e-6
COMMANDED = np.array([[0.0, 0.0], [8.5e-3, 0.0]])


def windows(rng, cycles=20, n=1000, sigma=SIGMA):
    return COMMANDED[:, None, None, :] + sigma * rng.normal(size=(2, cycles, n, 2))


def test_windows_are_the_end_of_every_dwell():
    chop = np.arange(2 * 2 * 10, dtype=float)[:, None]  # two cycles of two dwells of ten samples
    cut = observation_windows(np.vstack([chop, [[99.0]]]), levels=2, dwell=10, window=3)
    np.testing.assert_array_equal(cut[:, :, :, 0], [[[7, 8, 9], [27, 28, 29]], [[17, 18, 19], [37, 38, 39]]])


def test_white_noise_gives_the_closed_form_percentage():
    found = chop_stability(windows(np.random.default_rng(7)), COMMANDED)
    expected = 100.0 * (1.0 - np.exp(-0.5 * (1.7e-6 / SIGMA) ** 2))  # Rayleigh
    assert np.all(np.abs(found.inside_percent - expected) < 4.0 * found.inside_std)
    assert np.all(np.abs(found.three_sigma_rad - 3.0 * SIGMA) < 4.0 * found.three_sigma_std_rad)
    assert found.stability_rad == found.three_sigma_rad.max()


def test_accuracy_and_repeatability_of_shifted_windows():
    exact = np.broadcast_to(COMMANDED[:, None, None, :], (2, 2, 5, 2)).copy()
    exact[1, 0, :, 0] += 3e-7  # one window of the second position lies off by 0.3 µrad: the mean by 0.15
    exact[0] += np.array([3e-6, 4e-6])
    found = chop_stability(exact, COMMANDED)
    np.testing.assert_allclose(found.accuracy_rad, [5e-6, 0.15e-6], rtol=1e-6)
    np.testing.assert_allclose(found.repeatability_rad, [0.0, 0.15e-6], rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(found.inside_percent, 100.0)


def test_offsets_have_no_mean():
    off = offsets(windows(np.random.default_rng(8)))
    assert off.shape == (2, 20_000, 2)
    np.testing.assert_allclose(off.mean(axis=1), 0.0, atol=1e-15)


@pytest.mark.parametrize(("levels", "dwell", "window"), [(2, 30, 10), (2, 10, 11), (0, 10, 5), (2, 10, 0)])
def test_chops_without_a_whole_cycle_are_refused(levels, dwell, window):
    with pytest.raises(DataError, match="one whole cycle"):
        observation_windows(np.zeros((40, 2)), levels, dwell, window)


def test_one_command_per_position():
    with pytest.raises(DataError, match="one command per position"):
        chop_stability(np.zeros((2, 3, 10, 2)), np.zeros((1, 2)))
