"""The stored tolerances are those that the code computes; by another route: test_table_6_4.py."""

import numpy as np

from analysis.paper.high_mode import Roots
from analysis.paper.numbers import paper_tables
from analysis.paper.rounding import RULE, drawn, rounding_tolerances
from tests.sim_backend.paper_plants import THETA_X_DEN, THETA_X_NUM

HALF_UNITS = (
    np.array([5e11, 5e13, 5e18, 5e20, 5e24]),
    np.array([0.0, 0.05, 5e5, 5e7, 5e12, 5e13, 5e17, 5e18, 5e22]),
)
"""Of Table 6.2: 5.11, 3.72, 4.95, 1.00 and 2.77; 1, 178.5, 1.68, 1.45, 1.60, 4.85, 9.51, 9.71 and 3.09."""


def stored():
    return {(key, n.key): n.tolerance for key, table in paper_tables().items() for n in table.rows if n.rule == RULE}


def test_what_is_stored_is_what_is_computed():
    assert rounding_tolerances() == stored()


def test_a_few_draws_give_every_row_and_the_same_again():
    few = rounding_tolerances(draws=3)
    assert set(few) == set(stored()) and len(few) == 15
    assert few == rounding_tolerances(draws=3) != rounding_tolerances(draws=3, seed=1)
    # the feed-forward is designed on the plant itself: what is left is half of 0.1 ms
    assert few["6.4", "2 settling"] == few["6.4", "own settling"] == 0.05


def test_draws_fill_the_half_units_around_the_printed_digits():
    rng = np.random.default_rng(4)
    draws = [drawn(rng) for _ in range(400)]
    for i, (printed, half) in enumerate(zip((THETA_X_NUM, THETA_X_DEN), HALF_UNITS, strict=True)):
        off = np.array([d[i] for d in draws]) - np.array(printed)
        free = half > 0.0
        share = off[:, free] / half[free]
        # no draw outside by more than floating-point numbers, and 400 of them come within 5 % of either end
        assert np.abs(share).max() < 1.0 + 1e-6 and share.max(axis=0).min() > 0.95 and share.min(axis=0).max() < -0.95
        assert np.all(off[:, ~free] == 0.0)


def test_the_printed_polynomials_are_the_middle():
    printed, middle = Roots.printed(), Roots.of(np.array(THETA_X_NUM), np.array(THETA_X_DEN))
    np.testing.assert_allclose(printed.upper, middle.upper, rtol=1e-12)
    np.testing.assert_allclose(printed.zeros, middle.zeros, rtol=1e-12)
