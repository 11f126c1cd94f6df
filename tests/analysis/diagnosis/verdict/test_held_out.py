"""Where nothing repeats, held-out rows decide whether "it is noise" and "it is this" can be believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.result import Domain, Gain, Remainder
from analysis.diagnosis.verdict.held_out import follows_play, leaves_most, loses, validated
from analysis.diagnosis.verdict.judging import Judgement

UNSTEADY = "the residual is not steady noise"
CONSISTENT = Judgement("consistent", (), (), 1.0, 1.0, ())
NAMED = Judgement("named", (0,), (), 0.999, 1.0, ())


def gain(before: float, after: float, noise: float, ci95: tuple[float, float]) -> Gain:
    return Gain(("run#held-out",), before, after, noise, 1.0 - after / before, ci95)


USELESS = gain(0.95, 0.95, 0.9, (0.0, 0.0))
NOTHING_GAINED = gain(0.26, 0.27, 0.01, (-0.2, 0.1))


def test_a_model_that_explains_nothing_is_not_consistent_with_what_is_no_noise() -> None:
    doubt = validated(CONSISTENT, USELESS, False, UNSTEADY)
    assert doubt.verdict == "unknown"
    assert "most of the held-out output" in doubt.failed_check


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
    assert validated(CONSISTENT, found, repeats, unsteady) is CONSISTENT


def test_a_cause_that_gains_nothing_on_other_rows_has_no_name() -> None:
    doubt = validated(NAMED, NOTHING_GAINED, False, "")
    assert (doubt.verdict, doubt.named, doubt.tied) == ("unknown", (), ())
    assert "gains nothing on the held-out" in doubt.failed_check


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
    assert validated(NAMED, found, repeats, "") is NAMED


NOISY = Gain(("run#held-out",), 0.13, 0.13, 0.1, 0.0, (0.0, 0.0), least_error=0.125)
LEFT = Gain(("run#held-out",), 0.5, 0.13, 0.1, 0.74, (0.7, 0.8), least_error=0.125)


@pytest.mark.parametrize("repeats", [True, False])
def test_a_held_out_error_above_the_noise_is_not_consistent(repeats: bool) -> None:
    doubt = validated(CONSISTENT, NOISY, repeats, "")
    assert doubt.verdict == "unknown" and "1.3 times the noise" in doubt.failed_check
    assert validated(CONSISTENT, replace(NOISY, least_error=0.119), repeats, "") is CONSISTENT


@pytest.mark.parametrize("repeats", [True, False])
def test_what_a_name_leaves_of_held_out_rows_is_told(repeats: bool) -> None:
    told = validated(NAMED, LEFT, repeats, "")
    assert told.verdict == "named" and told.named == NAMED.named
    assert told.remainder is not None
    assert told.remainder.share == pytest.approx((0.13**2 - 0.1**2) / (0.5**2 - 0.1**2))
    known = replace(NAMED, remainder=Remainder(0.2, 1e-9, "a torque that follows time"))
    assert validated(known, LEFT, repeats, "") is known


@pytest.mark.parametrize(("after", "likelier", "lost"), [(0.101, False, True), (0.101, True, False), (0.2, True, True)])
def test_a_loss_that_slow_noise_decides_is_none_unless_it_is_large(after, likelier, lost) -> None:
    worse = Gain(
        ("run#held-out",), 0.1, after, 0.07, 1.0 - after / 0.1, (-1.2, -0.001), times=float(likelier), times_std=0.1
    )
    assert loses(worse) is lost


@pytest.mark.parametrize(
    ("times", "std", "name", "tie"),
    [
        (1.1, 0.01, "named", "ambiguous"),
        (0.7, 0.2, "named", "ambiguous"),
        (0.7, 0.05, "named", "unknown"),
        (2.3, 0.02, "named", "unknown"),
        (0.3, 0.1, "named", "unknown"),
        (0.3, 0.05, "unknown", "unknown"),
        (-0.3, 0.2, "unknown", "unknown"),
    ],
)
def test_a_cause_that_misses_more_than_it_explains_has_no_name(times, std, name, tie) -> None:
    """Of less than half its size it leaves more squares than it takes away; of more it is short of something else."""
    level = Gain(("run#held-out",), 0.1, 0.1, 0.1, 0.0, (-0.01, 0.01), times=times, times_std=std)
    assert validated(NAMED, level, True, "").verdict == name
    tied = replace(NAMED, verdict="ambiguous", named=(), tied=(("coulomb-friction", "hysteresis"),))
    assert validated(tied, level, True, "").verdict == tie
    told = replace(NAMED, remainder=Remainder(0.1, 1e-3, "the position"))
    assert validated(told, level, True, "").verdict == "named"
    assert validated(replace(NAMED, verdict="consistent", named=()), level, True, "").verdict == "consistent"


@pytest.mark.parametrize("repeats", [True, False])
def test_a_model_that_loses_on_held_out_rows_has_no_name(repeats: bool) -> None:
    worse = Gain(("run#held-out",), 0.1, 0.2, 0.09, -1.0, (-1.2, -0.8), least_error=0.19)
    doubt = validated(NAMED, worse, repeats, "")
    assert (doubt.verdict, doubt.named) == ("unknown", ()) and "worse than the model without it" in doubt.failed_check


def test_most_of_the_output_is_half_of_its_squares() -> None:
    assert leaves_most(gain(0.72, 0.7, 0.1, (0.0, 0.0)))
    assert not leaves_most(gain(0.70, 0.7, 0.1, (0.0, 0.0)))
    assert not leaves_most(None)


def evidence(**p_values: tuple[float, ...]) -> dict[str, tuple[Domain, ...]]:
    one = np.ones(2)
    return {name: tuple(Domain("run", "x", one, "m", one, one, p, "") for p in ps) for name, ps in p_values.items()}


@pytest.mark.parametrize(
    ("shown", "follows"),
    [
        (evidence(position=(0.3, 1e-9), time=(1e-4,)), True),
        (evidence(rate=(1e-20,), time=(1e-20,)), True),
        (evidence(position=(0.3, 1e-9), time=(1e-12,)), False),  # a shock is large at some time, and at some position
        (evidence(frequency=(1e-12,), position=(0.1,), time=()), False),
        (evidence(position=(4e-7, 0.5, 0.5), time=()), False),  # of three curves, and of two domains
    ],
)
def test_noise_follows_what_is_played(shown: dict[str, tuple[Domain, ...]], follows: bool) -> None:
    assert follows_play(shown) is follows


def test_a_noise_that_follows_what_is_played_is_none() -> None:
    doubt = validated(CONSISTENT, USELESS, True, UNSTEADY, True)
    assert (doubt.verdict, doubt.failed_check) == ("unknown", UNSTEADY)
    assert validated(CONSISTENT, gain(0.7, 0.7, 0.1, (0.0, 0.0)), False, UNSTEADY, True).verdict == "unknown"
    assert validated(CONSISTENT, gain(0.7, 0.7, 0.1, (0.0, 0.0)), False, UNSTEADY, False) is CONSISTENT
    assert validated(NAMED, USELESS, True, "", True) is NAMED
