"""What a fit may move of an effect, and what it believes of that beforehand."""

import numpy as np
import pytest

from analysis.diagnosis.candidates.parameters import parameters_of
from analysis.diagnosis.candidates.signature import Candidate, Scales, enumerate_candidates
from sim_backend.assembly import Places
from sim_backend.effects import EFFECTS, Aux, effect_class
from sim_backend.effects.amplifier_lag import AmplifierLag
from sim_backend.effects.periodic_torque import PeriodicTorque
from sim_backend.effects.view import RecordView

PLACES = Places(("x",), ("x",), (), (), np.zeros((0, 1)), np.eye(1), np.eye(1))
SCALES = Scales(np.ones(1), np.ones(1), 0.01, 10.0)
SEARCHED = [e for e in EFFECTS if e.aux not in (Aux.EXOGENOUS, Aux.SOURCE_COMMAND, Aux.SOURCE_POSITION)]


def starts(effect):
    """Every start in a record that shows all effects: warming up, its residual a line and a ripple."""
    n, rng = 4000, np.random.default_rng(1)
    t = np.arange(n) / 2000.0
    position = np.sin(2 * np.pi * 3.0 * t) + 0.01 * rng.standard_normal(n)
    residual = np.sin(2 * np.pi * 200.0 * t) + np.sin(40.0 * position) + 0.1 * rng.standard_normal(n)
    rate = np.gradient(position, t)
    view = RecordView(2000.0, rng.standard_normal(n), position, rate, residual, 77.0 + t, 20.0)
    return enumerate_candidates([effect], PLACES, {"x": view}, SCALES)


@pytest.mark.parametrize("effect", SEARCHED, ids=lambda e: e.name)
def test_every_parameter_of_a_fit_has_a_belief_with_a_width(effect):
    for candidate in starts(effect):
        scales, x = parameters_of([candidate], np.ones(max(len(candidate.unit_sizes), 1)))
        assert all(0.0 < s.sd < np.inf and np.isfinite(s.mean) for s in scales), effect.name
        assert np.all(np.isfinite(x))


@pytest.mark.parametrize("effect", SEARCHED, ids=lambda e: e.name)
def test_constants_of_a_description_are_not_fitted(effect):
    fixed = {p.name for p in effect.parameters() if p.fixed}
    for candidate in starts(effect):
        scales, _ = parameters_of([candidate], np.ones(max(len(candidate.unit_sizes), 1)))
        assert not fixed & {s.name for s in scales}


def test_what_measures_an_effect_by_itself_may_be_of_any_size():
    """A time constant of a hundredth of a sample is believed as much as one of a sample: both within one deviation."""
    measuring = {e.name for e in SEARCHED for c in starts(e) for s in parameters_of([c], np.ones(9))[0] if s.measures}
    assert {"amplifier-lag", "dead-zone"} <= measuring
    assert not measuring & {"amplifier-saturation", "bouc-wen", "hysteresis", "delay"}
    (scale,) = parameters_of(list(starts(AmplifierLag))[:1], np.ones(1))[0]
    assert abs(scale.forth(0.01 / 2000.0) - scale.forth(1.0 / 2000.0)) < scale.sd


def test_a_period_stays_within_what_the_motion_repeats():
    """A pattern that would come again only beyond the motion is none: a fit must not end there, nor begin."""
    position = np.sin(np.linspace(0.0, 20.0 * np.pi, 4000))
    zero = np.zeros(position.size)
    view = RecordView(1000.0, zero, position, zero, zero, None, 10.0)
    limits = PeriodicTorque.limits(view)
    # a sine is within cos(π/20) of its swing for nine tenths of the time
    assert abs(limits["period"][1] - 2.0 * np.cos(np.pi / 20.0)) < 1e-2
    unit, middle = {"cosine": 1.0, "sine": 1.0}, {"period": 0.5}
    for start, expected in ((0.5, 0.5), (40.0, limits["period"][1])):
        candidate = Candidate(PeriodicTorque, "x", {"period": start}, unit, middle, 1, limits)
        scales, x = parameters_of([candidate], np.ones(2))
        (period,) = [(s, v) for s, v in zip(scales, x, strict=True) if s.name == "period"]
        assert abs(period[0].back(period[1]) - expected) < 1e-12
        assert period[0].back(100.0) == limits["period"][1]


def test_a_shape_that_a_fit_has_left_at_zero_can_leave_it_again():
    """A reversible part of zero is as far from the usual fifth as that is from zero, not 10¹¹ of its own sizes."""
    effect = effect_class("jiles-atherton")
    shapes = {"a": 1e-3, "pinning": 1e-3, "c": 0.0}
    candidate = Candidate(effect, "x", shapes, {"size": 1.0}, {"a": 1e-3, "pinning": 1e-3, "c": 0.2})
    scales, x = parameters_of([candidate], np.ones(1))
    ((reversible, value),) = [(s, v) for s, v in zip(scales, x, strict=True) if s.name == "c"]
    assert value == 0.0
    assert abs(reversible.forth(0.2)) <= 1.0
    assert reversible.back(reversible.difference(0.0)) > 1e-9  # far above the rounding of what it changes
