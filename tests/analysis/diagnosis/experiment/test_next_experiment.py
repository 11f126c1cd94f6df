"""Which experiment is proposed for two causes that a slow record leaves tied."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import msgspec
import numpy as np
import pytest

from analysis.diagnosis.answer.sentence import sentence
from analysis.diagnosis.experiment.next_experiment import ENOUGH, LEAST, choose
from analysis.diagnosis.result import Choice, NextExperiment
from campaigns.plans import make_plan
from sim_backend.effects import make_effect
from sim_backend.effects.words import effect_text
from sim_backend.model import Model
from sim_backend.simbench import SimBench
from tests.analysis.diagnosis.experiment.test_separation import hypothesis, one_axis, read, setting_of, sine

CUBIC, CONSTANT = "cubic-stiffness", "position-dependent-force-constant"


@pytest.fixture(scope="module")
def tied():
    """What a search leaves after a slow loop on a cubic spring, and its verdict."""
    model, u = one_axis(), sine(0.02, 1.0, 2000)
    setting = setting_of(model, u, read(model, u, [make_effect(CUBIC, "theta_x", {"stiffness": 3000.0})]))
    first = hypothesis(model, setting, CUBIC, stiffness=3000.0)
    second = hypothesis(model, setting, CONSTANT, linear=0.0, quadratic=-260.0)
    found = SimpleNamespace(setting=setting, best=first.fit, rivals=(second.fit,))
    return found, SimpleNamespace(verdict="ambiguous", tied=((CUBIC, CONSTANT),), rivals=((CONSTANT, -1.0),))


Tied = tuple[Any, Any]


def chosen(tied: Tied, model: Model, *more: Any) -> Choice:
    choice = choose(*tied, model, *more)
    assert choice is not None
    return choice


def proposed(tied: Tied, *more: Any) -> NextExperiment:
    plan = chosen(tied, one_axis(), *more).experiment
    assert plan is not None
    return plan


def test_the_proposal_separates_what_the_old_record_could_not(tied):
    choice = chosen(tied, one_axis())
    plan = choice.experiment
    assert plan is not None
    assert plan.separates == (CUBIC, CONSTANT) and plan.expected_sigma >= ENOUGH
    # no limits are stated, so nothing beyond what was recorded: no command above 0.02 N m, as played
    bench = SimBench(one_axis(), 0)
    segments = list(make_plan(plan.test, plan.settings).segments(bench))
    assert max(np.max(np.abs(s.feedforward)) for s in segments) <= 1.1 * 0.02
    assert plan.duration_s == pytest.approx(sum(s.n_samples for s in segments) / 1000.0)
    said = f"The plan {plan.test} would distinguish {effect_text(CUBIC)} from {effect_text(CONSTANT)}"
    assert said in sentence("unknown", (), (), None, {}, choice)


def test_what_is_done_is_not_proposed_again(tied):
    first = proposed(tied)
    second = proposed(tied, None, [make_plan(first.test, first.settings)])
    assert (second.test, second.settings) != (first.test, first.settings)


def test_nothing_is_proposed_where_nothing_separates(tied):
    """Noise a thousand times larger: the same plans, the same limits, and no hope."""
    found, judgement = tied
    model, u = one_axis(), found.setting.data.records[0].u
    loud = setting_of(model, u, found.setting.data.records[0].y, noise=1e-3)
    whole = SimpleNamespace(setting=loud, best=found.best, rivals=found.rivals)
    choice = chosen((whole, judgement), model)
    assert choice.experiment is None
    sigma = re.search(r"by (\S+) sigma", choice.reason)
    assert sigma is not None and float(sigma[1]) < LEAST
    assert f"no plan distinguishes {effect_text(CUBIC)} from {effect_text(CONSTANT)}" in choice.reason
    assert "No plan distinguishes" in sentence("unknown", (), (), None, {}, choice)


def consistent_with(tied: Tied, gain: float) -> Tied:
    """What a search leaves when this evidence of a cubic spring stays below a threshold of 22."""
    found, judgement = tied
    candidates, sizes = found.best.held()
    screen = SimpleNamespace(
        candidates=candidates,
        gains=np.array([gain]),
        sizes=(sizes,),
        threshold=np.array([22.0]),
        best_per_key=lambda: [0],
    )
    none = replace(found.best, candidates=(), effects=(), names=(), values=np.zeros(0), std=np.zeros(0))
    whole = SimpleNamespace(**{**vars(found), "tuned": none, "first": screen})
    return whole, SimpleNamespace(**{**vars(judgement), "verdict": "consistent"})


def test_a_suspect_below_the_threshold_gets_the_experiment_that_would_show_it(tied):
    plan = proposed(consistent_with(tied, 16.0))
    assert plan.separates == ("no further effect", CUBIC) and plan.expected_sigma >= ENOUGH
    assert choose(*consistent_with(tied, 12.0), one_axis()) is None


def test_a_verdict_that_leaves_no_question_gets_no_proposal(tied):
    found, judgement = tied
    named: Any = SimpleNamespace(**{**vars(judgement), "verdict": "named"})
    assert choose(found, named, one_axis()) is None


def test_a_bench_at_another_rate_is_told_apart(tied):
    other = SimBench(msgspec.structs.replace(one_axis(), sample_rate_hz=500.0), 0)
    choice = chosen(tied, one_axis(), other)
    assert choice.experiment is None and "1000 Hz" in choice.reason and "500" in choice.reason
