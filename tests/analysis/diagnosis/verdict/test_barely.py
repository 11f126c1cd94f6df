"""Where nothing repeats, held-out rows decide whether "it is noise" and "it is this" can be believed."""

from __future__ import annotations

import pytest

from analysis.diagnosis.result import Gain
from analysis.diagnosis.verdict.barely import barely_explained, doubted
from analysis.diagnosis.verdict.judging import Judgement

UNSTEADY = "the residual is no steady noise"
CONSISTENT = Judgement("consistent", (), (), 1.0, 1.0, ())
NAMED = Judgement("named", (0,), (), 0.999, 1.0, ())


def gain(before: float, after: float, noise: float, ci95: tuple[float, float]) -> Gain:
    return Gain(("run#held-out",), before, after, noise, 1.0 - after / before, ci95)


USELESS = gain(0.95, 0.95, 0.9, (0.0, 0.0))
NOTHING_GAINED = gain(0.26, 0.27, 0.01, (-0.2, 0.1))


def test_a_model_that_explains_nothing_is_not_consistent_with_what_is_no_noise() -> None:
    doubt = doubted(CONSISTENT, USELESS, False, UNSTEADY)
    assert doubt.verdict == "unknown"
    assert "most of the held-out output" in doubt.objection


@pytest.mark.parametrize(
    ("found", "repeats", "unsteady"),
    [
        (USELESS, False, ""),  # steady noise may be as loud as it likes
        (USELESS, True, UNSTEADY),  # periods tell the noise, whatever the model is worth
        (gain(0.7, 0.7, 0.1, (0.0, 0.0)), False, UNSTEADY),  # it explains 51 % of the squares
        (None, False, UNSTEADY),
    ],
)
def test_a_consistent_verdict_stays_otherwise(found: Gain | None, repeats: bool, unsteady: str) -> None:
    assert doubted(CONSISTENT, found, repeats, unsteady) is CONSISTENT


def test_a_cause_that_gains_nothing_on_other_rows_has_no_name() -> None:
    doubt = doubted(NAMED, NOTHING_GAINED, False, "")
    assert (doubt.verdict, doubt.named, doubt.tied) == ("unknown", (), ())
    assert "gains nothing on the held-out" in doubt.objection


@pytest.mark.parametrize(
    ("found", "repeats"),
    [
        (NOTHING_GAINED, True),
        (gain(0.26, 0.2, 0.01, (0.1, 0.4)), False),  # it gains something
        (gain(0.0103, 0.0101, 0.01, (-0.1, 0.2)), False),  # a weak cause: what is left is the noise
        (None, False),
    ],
)
def test_a_name_stays_otherwise(found: Gain | None, repeats: bool) -> None:
    assert doubted(NAMED, found, repeats, "") is NAMED


def test_most_of_the_output_is_half_of_its_squares() -> None:
    assert barely_explained(gain(0.72, 0.7, 0.1, (0.0, 0.0)))
    assert not barely_explained(gain(0.70, 0.7, 0.1, (0.0, 0.0)))
    assert not barely_explained(None)
