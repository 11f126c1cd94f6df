"""One mode for a pair: what it keeps of both, by the expansion far from them, and what a sweep of a pair shows."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from analysis.paper.broad_mode import broad_mode, nearest_pair
from sim_backend.linear import ModalModel


def modes(frequency_hz, decay_1_s, residue):
    m = len(frequency_hz)
    return ModalModel(
        2.0 * np.pi * np.array(frequency_hz),
        np.array(decay_1_s),
        np.full((m, 1), 2.0),
        np.zeros((m, 1)),
        np.array([residue]) / 2.0,
        np.zeros((1, m)),
        np.zeros((1, 1)),
        np.zeros(1),
    )


BENCH = modes([1470.0, 29.56, 1405.0, 489.5], [20.0, 4.8, 50.0, 28.0], [-1000.0, 3092.0, -2000.0, 143.0])


def test_the_pair_is_the_one_nearest_in_ratio_whatever_the_order():
    assert nearest_pair(BENCH) == (2, 0)
    with pytest.raises(ValueError, match="needs two"):
        nearest_pair(modes([30.0], [1.0], [1.0]))


def test_the_broad_mode_by_hand():
    made = broad_mode(BENCH)
    assert made is not None and made.n_blocks == 3
    # two thirds of the lower, one of the upper
    assert made.omega_rad_s[-1] == pytest.approx(2.0 * np.pi * np.sqrt((2 * 1405.0**2 + 1470.0**2) / 3.0))
    assert made.sigma_1_s[-1] == pytest.approx(40.0)
    np.testing.assert_array_equal(made.omega_rad_s[:2], BENCH.omega_rad_s[[1, 3]])


@pytest.mark.parametrize("frequency_hz", [10.0, 100_000.0])
def test_from_afar_it_acts_as_both(frequency_hz):
    pair = modes([1405.0, 1470.0], [50.0, 20.0], [-2000.0, -1000.0])
    f = np.array([frequency_hz])
    made = broad_mode(pair)
    assert made is not None
    one, both = (m.frequency_response(f)[0, 0, 0] for m in (made, pair))
    # the variance of ω² over ω⁴ is (2/3)(1/3)(0.0924)² = 0.0019: the static gain differs by that, and beyond 100 kHz
    # the expansion by that times (1.4/100)⁴
    assert abs(one / both - 1.0) < (2e-3 if frequency_hz < 1e3 else 1e-6)


def test_a_pair_of_opposite_signs_has_no_broad_mode():
    assert broad_mode(modes([1405.0, 1470.0], [34.0, 34.0], [-1000.0, 1000.0])) is None


def resonance(frequency_hz, decay_1_s):
    f = np.arange(1350.0, 1551.0, 5.0)
    omega, s = 2.0 * np.pi * frequency_hz, 2j * np.pi * f
    return 1.0 / (s**2 + 2.0 * decay_1_s * s + omega**2)


CRITERIA = {
    "magnitude": lambda ours, theirs: (np.abs(ours) - np.abs(theirs)) / np.abs(theirs).max(),
    "logarithm of the magnitude": lambda ours, theirs: np.log(np.abs(ours) / np.abs(theirs)),
    "response": lambda ours, theirs: np.concatenate([(d := (ours - theirs) / np.abs(theirs).max()).real, d.imag]),
    "relative response": lambda ours, theirs: np.concatenate([(d := (ours - theirs) / np.abs(theirs)).real, d.imag]),
}


@pytest.mark.parametrize("criterion", CRITERIA)
def test_one_mode_fitted_to_the_pair_is_not_the_papers(criterion):
    # what docs/bench-model.md says of it: the text's 1440 Hz with the 34 1/s of θy is no least squares of the pair
    pair = resonance(1405.0, 34.0) + resonance(1470.0, 34.0)

    def distance(p):
        return CRITERIA[criterion](p[2] * resonance(p[0], p[1]), pair)

    bounds = ([1300.0, 1.0, 0.1], [1600.0, 2000.0, 20.0])
    starts = [(f, s, 2.0) for f in (1405.0, 1437.5, 1470.0) for s in (20.0, 100.0, 400.0)]
    best = min(
        (least_squares(distance, start, bounds=bounds, x_scale=[10.0, 10.0, 0.1]) for start in starts),
        key=lambda fit: fit.cost,
    )
    assert best.cost < 0.98 * least_squares(lambda g: distance((1440.0, 34.0, g[0])), [2.0]).cost
    assert abs(best.x[0] - 1440.0) > 5.0 or abs(best.x[1] / 34.0 - 1.0) > 0.5
