"""A level per run against drawn numbers, and what either kind of level leaves of Table 6.7."""

import numpy as np
import pytest

from analysis.paper.run_levels import level_rad, misses, printed_shares, run_levels, share_inside


@pytest.mark.parametrize("share", [0.9654, 0.9969])
def test_the_level_gives_the_share(share):
    sigma = level_rad(share) / 3.0
    drawn = np.mean(np.hypot(*np.random.default_rng(4).normal(0.0, sigma, (2, 400_000))) <= 1.7e-6)
    # 400,000 draws know a share of 96.5 % to 0.03 %, four times that
    assert drawn == pytest.approx(share, abs=1.2e-3)
    assert share_inside(level_rad(share)) == pytest.approx(share, rel=1e-12)


def test_misses_by_hand():
    shares = {"a": (0.98, 0.99), "b": (0.98, 0.97)}
    own, common = misses(shares)
    # both runs have the same position 1: a level for each is the one level
    assert own == pytest.approx(0.01) and common == pytest.approx(0.01)
    own, common = misses({"a": (0.99, 0.99), "b": (0.95, 0.95)})
    assert own == 0.0 and common > 0.015


def test_a_level_per_run_predicts_position_2_of_the_paper_better_than_one_level():
    own, common = misses(printed_shares())
    assert own < 0.6 * common
    assert len(run_levels().rows) == 9
