"""Nothing was named, yet something stands out: it makes the verdict unknown, unless causes of the spread may be it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.discrepancy import Discrepancy
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import Screen
from analysis.diagnosis.verdict.judging import judge, shortfall
from sim_backend.effects import effect_class
from tests.analysis.diagnosis.residuals import setting_of

ROWS = 4000
THRESHOLD = 20.0


def _found(gain: float) -> Found:
    """Return an outcome without causes, beside which a vibration line has so much evidence and was never refitted."""
    noise = np.random.default_rng(0).standard_normal(ROWS)
    setting, tuned = setting_of(np.zeros(ROWS), noise, noise, 1.0, period=ROWS // 4)
    shape = {"frequency_hz": 5.0}
    line = Candidate(effect_class("vibration-line"), "x", shape, {}, shape)
    one = np.ones(1)
    last = Screen((line,), gain * one, gain * one, (one,), (one,), one, THRESHOLD * one)
    return Found(setting, tuned, tuned, (tuned,), last, last, 0.0, Discrepancy(("x",), (0.0,)))


@pytest.mark.parametrize(
    ("gain", "random", "verdict"),
    [
        (19.0, 0.0, "consistent"),
        (21.0, 0.0, "unknown"),
        (37.0, 16.0, "unknown"),
        (37.0, 18.0, "consistent"),
        (300.0, 0.0, "unknown"),
        (300.0, 279.0, "unknown"),
        (300.0, 281.0, "consistent"),
    ],
)
def test_what_stands_out_counts_less_what_causes_of_the_spread_may_be(gain: float, random: float, verdict: str) -> None:
    assert judge(_found(gain), random=random).verdict == verdict


@pytest.mark.parametrize(("beyond", "chance"), [(0.0, "99 %"), (-2.0, "97 %"), (-3.9, "93 %")])
def test_what_stands_out_by_too_little_is_told_with_its_chance(beyond: float, chance: str) -> None:
    """A lead that is the price makes 99 to 1; one that is less by 2 makes odds e times smaller."""
    outcome = _found(21.0)
    line = outcome.last.candidates[0]
    lead = outcome.first.price + beyond
    shown = replace(outcome.tuned, candidates=(line,), misfit=outcome.tuned.misfit - lead)
    outcome = replace(outcome, rivals=(outcome.tuned, shown))
    judged = judge(outcome)
    assert judged.verdict == "unknown"
    assert f"vibration line at x is above the noise and may be the cause, with a chance of {chance}" in shortfall(
        outcome, judged
    )


def test_what_is_worth_nothing_is_not_told() -> None:
    """A refit that gains most of what was promised and pays it all for its parameters: some effect is there, not it."""
    outcome = _found(21.0)
    shown = replace(outcome.tuned, candidates=outcome.last.candidates, misfit=outcome.tuned.misfit - 15.0, occam=15.0)
    outcome = replace(outcome, rivals=(outcome.tuned, shown))
    assert "no effect of the library explains a good part of it" in shortfall(outcome, judge(outcome))
