"""Thresholds of chance, on evidence of which the distribution is known, and what is fitted below them."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.search.shortlist import Screen, promising, thresholds
from sim_backend.effects import EFFECTS


def test_each_cause_has_its_own_threshold_and_all_share_one_rate() -> None:
    # a cause of thirty shapes, one of four sizes and six plain ones; ratios of noise alone are chi-squared
    rng = np.random.default_rng(11)
    keys = [("shapes", "x")] * 30 + [("sizes", "x")] + [(f"plain {i}", "x") for i in range(6)]

    def drawn(draws: int) -> np.ndarray:
        freedoms = np.array([1] * 30 + [4] + [1] * 6)
        return rng.chisquare(freedoms[:, None], (37, draws))

    limits = thresholds(keys, drawn(4000), 0.02)
    alarms = np.mean(np.any(drawn(40_000) > limits[:, None], axis=0))
    # the limit is a quantile of 4000 draws: 80 of them beyond, known to 11 %, and the offsets to as much
    assert alarms == pytest.approx(0.02, rel=0.4)
    # of eight causes each is allowed a part in four hundred: chi-squared of one degree of freedom beyond 9.14
    assert limits[-1] == pytest.approx(9.14, abs=0.7)
    assert limits[0] > limits[-1] + 4.0
    assert limits[30] > limits[-1] + 4.0


def test_of_what_does_not_stand_out_the_few_that_lower_the_squares_most_are_fitted() -> None:
    """Once for each effect and place; none that the model's numbers imitate, that was tried, or below half a price."""
    effects = EFFECTS[:6]
    places = [(e, "x") for e in effects] + [(effects[0], "x"), (effects[1], "y")]
    candidates = tuple(Candidate(effect, where, {}, {}, {}) for effect, where in places)
    n = len(candidates)
    price = Screen(candidates, np.zeros(n), np.zeros(n), (), (), np.ones(n), np.zeros(n)).price
    drops = price * np.array([0.9, 0.8, 0.7, 0.6, 0.4, 0.95, 0.91, 0.55])
    tolerance = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1e-9, 1.0, 1.0])
    found = Screen(candidates, np.zeros(n), drops, (), (), tolerance, np.full(n, 20.0))
    assert promising(found, effects, ()) == [6, 1, 2]
    assert promising(found, effects, {(effects[1].name, "x")}) == [6, 2, 3]
    assert promising(found, effects[3:], ()) == [3]
    assert promising(found, effects[4:], ()) == []
