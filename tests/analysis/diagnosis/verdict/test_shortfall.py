"""An unknown verdict tells how far the best explanation gets, without giving it a name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.discrepancy import Discrepancy
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import SURE_LEAD, Screen
from analysis.diagnosis.verdict.generic_alternative import GenericAlternative
from analysis.diagnosis.verdict.judging import judge, shortfall
from analysis.diagnosis.verdict.lack_of_fit import LackOfFit
from sim_backend.effects import make_effect
from tests.analysis.diagnosis.residuals import setting_of

ROWS = 4000
TELLING = LackOfFit("a torque that follows position", "x", 200.0, 200.0, 3)


def found(*, before: float, after: float) -> Found:
    """Return an outcome with a cubic spring as its cause, by the mean squares before and after it."""
    noise = np.random.default_rng(0).standard_normal(ROWS)
    setting, tuned = setting_of(np.zeros(ROWS), noise, noise, 1.0, period=ROWS // 4)
    spring = make_effect("cubic-stiffness", "x", {"stiffness": 1.0})
    candidate = Candidate(type(spring), "x", {}, {"stiffness": 1.0}, {})
    tuned = replace(tuned, misfit=before * tuned.rows)
    best = replace(tuned, candidates=(candidate,), effects=(spring,), misfit=after * tuned.rows)
    nothing = Screen((), np.zeros(0), np.zeros(0), (), (), np.zeros(0), np.zeros(0))
    return Found(setting, tuned, best, (best,), nothing, nothing, 1e4, Discrepancy(("x",), (0.0,)))


def rival(lead: float) -> GenericAlternative:
    return GenericAlternative((0,), ("cubic-stiffness at x",), (("position and rate", False, 0),), lead)


@pytest.mark.parametrize(
    ("after", "left", "words"),
    [
        (1.05, (TELLING,), "the best explanation, cubic stiffness at x, explains 97.5 % of what was more than noise"),
        (1.5, (), "explains 75 % of what was more than noise; it has no name here"),
    ],
)
def test_what_the_best_explanation_explains_is_told(after: float, left: tuple[LackOfFit, ...], words: str) -> None:
    """Where a part is left, a name asks for a sure lead over general laws; a small one is none."""
    outcome = found(before=3.0, after=after)
    judged = judge(outcome, left=left, general=[rival(SURE_LEAD - 0.1)])
    assert judged.verdict == "unknown" and judged.named == () and judged.remainder is None
    assert words in shortfall(outcome, judged)


@pytest.mark.parametrize(
    ("after", "left", "share"),
    [(1.05, (TELLING,), 200.0 / (2.0 * ROWS)), (1.5, (), 0.25), (1.5, (TELLING,), 0.25)],
)
def test_what_a_cause_leaves_that_is_surely_there_is_a_remainder(
    after: float, left: tuple[LackOfFit, ...], share: float
) -> None:
    outcome = found(before=3.0, after=after)
    judged = judge(outcome, left=left, general=[rival(SURE_LEAD + 0.1)])
    assert judged.verdict == "named" and judged.named == (0,)
    assert judged.remainder is not None
    # the rows are those of the noise-free total; what is left of it above one is the remainder
    assert judged.remainder.share == pytest.approx(max(share, (after - 1.0) / 2.0), rel=1e-6)
    assert judged.remainder.significance < 1e-6
    assert shortfall(outcome, judged) == ""


@pytest.mark.parametrize("before", [0.999, 1.001])
def test_no_part_is_told_of_a_total_that_may_be_noise(before: float) -> None:
    """What stands out of it may be a few squared deviations that follow one way."""
    outcome = found(before=before, after=0.99)
    judged = judge(outcome, left=(TELLING,), general=[rival(0.0)])
    assert judged.verdict == "unknown"
    told = shortfall(outcome, judged)
    assert "explains a significant part of a residual that may be noise in total; it has no name here" in told
    assert "%" not in told


def test_nothing_is_said_of_what_is_named() -> None:
    outcome = found(before=3.0, after=1.0)
    judged = judge(outcome)
    assert judged.verdict == "named" and judged.remainder is None
    assert shortfall(outcome, judged) == ""
