"""Which effects are given up at the end of a search."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.search.pruning import pruned
from sim_backend.effects import effect_class, make_effect
from tests.analysis.diagnosis.residuals import moved, setting_of

PRICE = 18.0


@pytest.mark.parametrize(("lead", "kept"), [(30.0, True), (10.0, False), (-8.0, False)])
def test_the_only_cause_is_worth_its_price_at_the_end_too(lead: float, kept: bool) -> None:
    """A rounded command was found in coarse steps and one noise; in its own it explained no more than nothing does."""
    rng = np.random.default_rng(4)
    force = np.repeat(rng.standard_normal(200), 5)
    reading = moved(force) + 1e-3 * rng.standard_normal(force.size)
    setting, _ = setting_of(force, reading, reading - moved(force), 1e-3)
    setting = replace(setting, states=(np.zeros((1, 2)),))
    tuned = refit(setting, (), np.zeros(0), np.zeros(0))
    candidate = Candidate(effect_class("command-quantisation"), "x", {}, {}, {})
    effect = make_effect("command-quantisation", "x", {"step_size": 0.1})
    best = replace(tuned, candidates=(candidate,), effects=(effect,), misfit=tuned.misfit - lead)
    found, _ = pruned(setting, best, tuned, PRICE)
    assert found is (best if kept else tuned)
