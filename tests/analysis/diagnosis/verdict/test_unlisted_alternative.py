"""A verdict is held against what is no listed cause; each check has its own case."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Scales
from analysis.diagnosis.fitting.discrepancy import Discrepancy
from analysis.diagnosis.nominal.tuning import nuisances_of
from analysis.diagnosis.pipeline import Options, diagnose
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.records.holding import with_held_out
from analysis.diagnosis.result import NOTHING_ADDED
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import Screen
from analysis.diagnosis.verdict import unlisted_alternative
from analysis.diagnosis.verdict.judging import failed_check, judge
from analysis.diagnosis.verdict.lack_of_fit import LackOfFit
from sim_backend.effects.cubic_stiffness import CubicStiffness
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, setting_of

ROWS = 4000


def _found(change: float = 0.0, discrepancy: float = 0.0, leads: tuple[tuple[str, float], ...] = ()) -> Found:
    """Return an outcome without effects whose first nuisance is `change` tolerances off, of noise of unit size."""
    noise = np.random.default_rng(0).standard_normal(ROWS)
    setting, fit = setting_of(np.zeros(ROWS), noise, noise, 1.0, period=ROWS // 4)
    setting = replace(setting, nuisances=nuisances_of(setting.nominal, 0.02))
    turned = np.zeros(len(setting.nuisances))
    turned[0] = change * 0.02
    fit = replace(fit, change=turned)
    nothing = Screen((), np.zeros(0), np.zeros(0), (), (), np.zeros(0), np.zeros(0))
    return Found(
        setting, fit, fit, (fit,), nothing, nothing, 1e4, Discrepancy(("x",), (discrepancy,)), unlisted_leads=leads
    )


def _left(gain: float) -> tuple[LackOfFit, ...]:
    return (LackOfFit("a torque that follows time", "x", gain, gain, 9),)


def test_noise_fails_no_check() -> None:
    assert failed_check(_found(change=2.0), _left(20.0)) == ""
    assert judge(_found(), left=_left(20.0)).verdict == "consistent"


def test_lack_of_fit_that_is_no_noise_is_told_with_its_place() -> None:
    """Of nine columns 60 is one in 10⁹; without any effect that contradicts *consistent*."""
    judged = judge(_found(), left=_left(60.0))
    assert judged.verdict == "unknown"
    assert "a torque that follows time at x" in judged.failed_check


@pytest.mark.parametrize(("discrepancy", "told"), [(30.0, False), (5.0, True)])
def test_what_the_form_of_the_cause_may_be_wrong_by_fails_no_check(discrepancy: float, told: bool) -> None:
    assert bool(failed_check(_found(discrepancy=discrepancy), _left(60.0))) is told


def test_random_causes_take_their_share_first() -> None:
    assert failed_check(_found(), _left(60.0), random=45.0) == ""


def test_nominal_numbers_far_beyond_their_tolerance_fail_a_check() -> None:
    """Chi-square of the three nuisances: 6.5² is four in 10⁹, 5² one in 7·10⁴."""
    assert len(_found().best.change) == 3
    assert "tolerance" in failed_check(_found(change=6.5), ())
    assert failed_check(_found(change=5.0), ()) == ""


def test_an_unlisted_torque_that_comes_near_fails_a_check() -> None:
    """A lead of log 99 = 4.6 is needed, as against any rival."""
    assert "x" in failed_check(_found(leads=(("x", 4.0),)), ())
    assert failed_check(_found(leads=(("x", 5.0),)), ()) == ""


@pytest.mark.parametrize(("lead", "told"), [(-1.0, True), (1.0, False)])
def test_one_torque_beside_known_noise_is_doubted_where_an_unlisted_one_is_better(
    monkeypatch: pytest.MonkeyPatch, lead: float, told: bool
) -> None:
    """Where it comes near, a small cause keeps its name; two causes do not, nor does one where noise is not known."""
    spring = CubicStiffness(where="x", stiffness=1.0)
    found = _found()
    found = replace(found, best=replace(found.best, effects=(spring,)))
    monkeypatch.setattr(unlisted_alternative, "_alternative", lambda *_: (found.best, 0.0))
    monkeypatch.setattr(unlisted_alternative, "_lead", lambda *_: lead)
    assert found.setting.whitener.repeats
    scales = Scales.__new__(Scales)
    against = unlisted_alternative.against_unlisted_alternatives(found, scales, lambda *_: None)
    assert against.unlisted_leads == ((("x", lead),) if told else ())
    shared = replace(found, best=replace(found.best, effects=(spring, replace(spring, stiffness=2.0))))
    two = unlisted_alternative.against_unlisted_alternatives(shared, scales, lambda *_: None)
    assert two.unlisted_leads == (("x", lead),)


def _played(law) -> Dataset:
    """Return one loud record that never repeats, of the oscillator with a force `law(x)`, by the Runge-Kutta rule."""
    rng, omega = np.random.default_rng(4), 2.0 * np.pi * 20.0
    u, x, h, fine = np.zeros(ROWS), np.zeros(2), 1.0 / RATE_HZ / 4, 4
    for k in range(1, ROWS):
        u[k] = 0.8 * u[k - 1] + 0.05 * rng.standard_normal()
    y = np.zeros(ROWS)

    def slope(x: np.ndarray, drive: float) -> np.ndarray:
        return np.array([x[1], omega**2 * (drive - x[0] - law(x[0])) - 24.0 * x[1]])

    for k in range(ROWS):
        y[k] = x[0]
        for _ in range(fine):
            k1 = slope(x, u[k])
            k2 = slope(x + 0.5 * h * k1, u[k])
            k3 = slope(x + 0.5 * h * k2, u[k])
            x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + slope(x + h * k3, u[k]))
    y += 1e-4 * rng.standard_normal(ROWS)
    held, _ = with_held_out([Record("played", u[:, None], y[:, None], (Window("all", 0, ROWS),))])
    return Dataset(RATE_HZ, held)


def test_a_cause_that_is_left_out_is_not_shared_out_among_others() -> None:
    """A cubic spring, searched without it: where nothing repeats, what a few others leave of it passes for noise."""
    data = _played(lambda x: 0.6 * x**3)
    without = ("cubic-stiffness", "hysteresis", "position-dependent-force-constant")
    found = diagnose(data, MODEL, Options(without=without))
    assert found.verdict == "unknown", found.sentence
    assert found.causes == ()
    named = diagnose(data, MODEL, Options())
    assert [cause.effect for cause in named.causes] == ["cubic-stiffness"], named.sentence
    # the model as it is was compared as well, and is far behind
    assert dict(named.considered)[NOTHING_ADDED] < min(-100.0, named.considered[0][1])
    # no temperature was recorded, so none could have been seen to act
    assert named.sensitivity and not any("thermal" in one.effect for one in named.sensitivity)
