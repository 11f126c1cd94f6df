"""Names meet at the limits of their shapes: what was fitted close to one could be called either."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.leeway import Leeway
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import Screen
from analysis.diagnosis.verdict.judging import judge
from sim_backend.effects import EFFECTS, make_effect
from tests.analysis.diagnosis.residuals import setting_of

ROWS = 4000
PEAK = 1e-3


def _found(gap: float) -> Found:
    """Return an outcome that noise of unit size is left of, with a free play of `gap` as its only cause."""
    noise = np.random.default_rng(0).standard_normal(ROWS)
    setting, tuned = setting_of(np.zeros(ROWS), noise, noise, 1.0, period=ROWS // 4)
    play = make_effect("backlash", "x", {"stiffness": 1.0, "gap": gap})
    shape, limits = {"gap": gap}, {"gap": (0.0, 0.5 * PEAK)}
    candidate = Candidate(type(play), "x", shape, {"stiffness": 1.0}, shape, 1, limits)
    best = replace(tuned, candidates=(candidate,), effects=(play,))
    nothing = Screen((), np.zeros(0), np.zeros(0), (), (), np.zeros(0), np.zeros(0))
    return Found(setting, tuned, best, (best,), nothing, nothing, 1e4, Leeway(("x",), (0.0,)))


@pytest.mark.parametrize(("part", "verdict"), [(0.2, "named"), (0.47, "named"), (0.49, "ambiguous")])
def test_a_play_of_nearly_half_the_swing_may_be_a_stop(part: float, verdict: str) -> None:
    judged = judge(_found(part * PEAK))
    assert judged.verdict == verdict
    assert judged.tied == ((("backlash", "end-stop-contact"),) if verdict == "ambiguous" else ())


def test_names_beyond_a_limit_are_causes_and_the_limits_those_of_shapes() -> None:
    reported = {e.reported() for e in EFFECTS}
    for effect in EFFECTS:
        assert set(effect.beyond) <= set(effect.shapes()), effect.name
        assert set(effect.beyond.values()) <= reported - {effect.reported()}, effect.name
