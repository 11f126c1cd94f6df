"""Which trials of a round are compared with care, and which of them leads."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.fit import Fit
from analysis.diagnosis.search.pruning import has_seen_model
from analysis.diagnosis.search.rounds import leading, n_compared
from sim_backend.effects import effect_class, make_effect


def test_what_would_be_tied_is_compared_under_its_own_noise() -> None:
    # a lead is twice a logarithm: 99 to 1 is 9.2, and twice that far behind is close
    leads = [100.0, 99.0, 95.0, 90.0, 85.0, 81.0, 0.0]
    assert n_compared(leads, known=False) == 5
    assert n_compared(leads, known=True) == 3


def test_three_are_compared_however_far_they_trail() -> None:
    assert n_compared([1000.0, 10.0, 5.0, 1.0], known=False) == 3


def fit_of(name: str, size: str, value: float, std: float) -> Fit:
    """Return a fit with one effect of which a size has that value and deviation."""
    none = np.zeros(0)
    candidate = Candidate(effect_class(name), "theta_x", {}, {}, {})
    effect = make_effect(name, "theta_x", {size: value})
    bare = Fit((candidate,), none, (effect,), 0.0, 0.0, 1, 0.0, 0.0, ((0, size),), none, none, (), ())
    return replace(bare, values=np.array([value]), std=np.array([std]))


SEEN = fit_of("extra-resonance", "participation", 0.3, 0.05)
UNSEEN = fit_of("extra-resonance", "participation", 0.01, 0.05)
TORQUE = fit_of("coulomb-friction", "torque", 0.01, 0.05)


def test_only_a_change_of_the_model_itself_has_to_be_seen() -> None:
    """Of another effect, numbers that are uncertain one by one may be certain together: pruning asks for that."""
    assert [has_seen_model(f) for f in (SEEN, UNSEEN, TORQUE)] == [True, False, True]


@pytest.mark.parametrize(
    ("trials", "scores", "first"),
    [
        ((UNSEEN, TORQUE, SEEN), (1.0, 5.0, 7.0), TORQUE),  # both others explain enough: the better of them
        ((UNSEEN, TORQUE, SEEN), (1.0, 7.0, 5.0), SEEN),
        ((UNSEEN, TORQUE), (1.0, 12.0), UNSEEN),  # the other one explains too little
        ((UNSEEN,), (1.0,), UNSEEN),
        ((SEEN, TORQUE), (12.0, 11.0), TORQUE),
    ],
)
def test_what_adds_nothing_to_the_model_leads_only_where_nothing_else_explains_enough(
    trials: tuple[Fit, ...], scores: tuple[float, ...], first: Fit
) -> None:
    assert leading(trials, scores, 10.0) is first
