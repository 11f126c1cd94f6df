"""Names meet at the limits of their shapes: what was fitted close to one could be called either."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.discrepancy import Discrepancy
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import SURE, SURE_LEAD, Screen
from analysis.diagnosis.verdict.generic_alternative import GenericAlternative
from analysis.diagnosis.verdict.judging import judge
from sim_backend.effects import EFFECTS, effect_class, make_effect
from sim_backend.effects.base import UNLISTED
from sim_backend.effects.view import RecordView
from tests.analysis.diagnosis.residuals import setting_of

ROWS = 4000
PEAK = 1e-3


def _found(gap: float) -> Found:
    """Return an outcome that noise of unit size is left of, with a free play of `gap` as its only cause."""
    return _outcome("backlash", {"stiffness": 1.0}, {"gap": gap}, {"gap": (0.0, 0.5 * PEAK)})


def _outcome(
    name: str, sizes: dict[str, float], shapes: dict[str, float], limits: dict[str, tuple[float, float]]
) -> Found:
    noise = np.random.default_rng(0).standard_normal(ROWS)
    setting, tuned = setting_of(np.zeros(ROWS), noise, noise, 1.0, period=ROWS // 4)
    effect = make_effect(name, "x", sizes | shapes)
    candidate = Candidate(type(effect), "x", shapes, sizes, shapes, 1, limits)
    best = replace(tuned, candidates=(candidate,), effects=(effect,))
    nothing = Screen((), np.zeros(0), np.zeros(0), (), (), np.zeros(0), np.zeros(0))
    return Found(setting, tuned, best, (best,), nothing, nothing, 1e4, Discrepancy(("x",), (0.0,)))


@pytest.mark.parametrize(("part", "verdict"), [(0.2, "named"), (0.47, "named"), (0.49, "ambiguous")])
def test_a_play_of_nearly_half_the_swing_may_be_a_stop(part: float, verdict: str) -> None:
    judged = judge(_found(part * PEAK))
    assert judged.verdict == verdict
    assert judged.tied == ((("backlash", "end-stop-contact"),) if verdict == "ambiguous" else ())


@pytest.mark.parametrize(("damping_ratio", "verdict"), [(1e-6, "named"), (0.15, "named"), (0.195, "unknown")])
def test_a_resonance_that_is_hardly_one_stands_for_something_else(damping_ratio: float, verdict: str) -> None:
    shapes = {"frequency_hz": 300.0, "damping_ratio": damping_ratio}
    judged = judge(_outcome("extra-resonance", {"participation": 0.5}, shapes, {"damping_ratio": (1e-6, 0.2)}))
    assert judged.verdict == verdict
    assert ("damping_ratio 0.195, up to whose limit of 0.2" in judged.failed_check) is (verdict == "unknown")


@pytest.mark.parametrize(("rms_rates", "verdict"), [(0.01, "named"), (0.4, "named"), (0.49, "unknown")])
def test_a_friction_that_fades_at_most_rates_stands_for_some_other_damping(rms_rates: float, verdict: str) -> None:
    """Of a swing at 1 rad/s rms, as the limits of the effect have it."""
    swing = np.sqrt(2.0) * np.sin(0.1 * np.arange(4000))
    view = RecordView(1000.0, swing, swing, swing, swing, None, 1.0)
    limits = effect_class("coulomb-friction").limits(view)
    judged = judge(_outcome("coulomb-friction", {"torque": 1.0}, {"breakaway_rate": rms_rates}, limits))
    assert judged.verdict == verdict


def test_the_posterior_counts_general_laws_beside_what_random_causes_explain() -> None:
    """A name falls where they lead by 99 to 1, and is as likely as they there; not where random causes explain it."""
    found = _found(0.2 * PEAK)

    def rival(lead: float) -> tuple[GenericAlternative, ...]:
        return (GenericAlternative((0,), ("backlash at x",), (("position and rate", False, 0),), lead),)

    assert judge(found).posterior == pytest.approx(1.0)
    assert judge(found, general=rival(0.0)).posterior == pytest.approx(SURE)
    assert judge(found, general=rival(-SURE_LEAD + 1e-9)).posterior == pytest.approx(0.5)
    assert judge(found, general=rival(-SURE_LEAD - 1e-9)).verdict == "unknown"
    assert judge(found, general=rival(-5.0), random=10.0).posterior == pytest.approx(SURE)


def test_names_beyond_a_limit_are_causes_and_the_limits_those_of_shapes() -> None:
    reported = {e.reported() for e in EFFECTS}
    for effect in EFFECTS:
        assert set(effect.beyond) <= set(effect.shapes()), effect.name
        assert set(effect.beyond.values()) <= reported - {effect.reported()} | {UNLISTED}, effect.name
