"""Numbers to which an effect led the nominal model are tried without it: what they gain is no merit of the effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.balance import iterated_gls, score, tuned_beside
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.nominal.tuning import change_to, nuisances_of, turned
from sim_backend.effects import EFFECTS
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, setting_of

DECAY_1_S, TRUE_HZ, NOISE = 0.2, 21.2, 1e-3


@pytest.fixture(scope="module")
def trapped() -> tuple[Setting, Fit, Fit]:
    """Return setting and fit of a mode nineteen widths away from where the data have it, and a fit that is there.

    The latter has an effect beside it that does nothing.
    """
    rng = np.random.default_rng(12)
    force = np.repeat(rng.normal(size=200), 25)
    omega = 2.0 * np.pi * TRUE_HZ
    top, bottom, _ = cont2discrete(([omega**2], [1.0, 2.0 * DECAY_1_S, omega**2]), 1.0 / RATE_HZ)
    reading = lfilter(top.ravel(), bottom, force) + NOISE * rng.normal(size=force.size)
    setting, _ = setting_of(force, reading, reading, NOISE)
    nominal = MODEL.linear().with_(sigma_1_s=np.array([DECAY_1_S]))
    nuisances = nuisances_of(nominal, 0.03)
    setting = replace(setting, nominal=nominal, nuisances=nuisances, states=(np.zeros((1, 2)),))
    setting, tuned = iterated_gls(setting, refit(setting, (), np.zeros(0), np.zeros(len(nuisances))))
    there = change_to(nominal, nuisances, nominal.with_(omega_rad_s=np.array([omega])))
    effect = next(e for e in EFFECTS if e.name == "coulomb-friction")
    beside = replace(tuned, candidates=(Candidate(effect, "x", {}, {}, {}),), change=there)
    return setting, tuned, beside


def test_numbers_found_beside_an_effect_are_kept_without_it(trapped: tuple[Setting, Fit, Fit]) -> None:
    setting, tuned, beside = trapped
    found = tuned_beside(setting, tuned, beside)
    assert found is not None
    own, fit = found
    assert not fit.candidates and score(fit, False) < score(tuned, False)
    omega = turned(own.nominal, own.nuisances, fit.change).omega_rad_s[0]
    # of 5 s and a thousandth of noise the frequency is known to far better than its width of 0.06 Hz
    assert omega / (2.0 * np.pi) == pytest.approx(TRUE_HZ, abs=0.005)


def test_numbers_that_are_no_better_without_it_are_not(trapped: tuple[Setting, Fit, Fit]) -> None:
    found = tuned_beside(*trapped)
    assert found is not None
    setting, tuned = found
    assert tuned_beside(setting, tuned, replace(trapped[2], change=tuned.change)) is None


def test_where_periods_repeat_or_no_number_has_moved_the_tuned_model_stays(trapped: tuple[Setting, Fit, Fit]) -> None:
    setting, tuned, beside = trapped
    known = replace(setting, whitener=replace(setting.whitener, repeats=True))
    assert tuned_beside(known, tuned, beside) is None
    assert tuned_beside(setting, tuned, replace(beside, change=tuned.change)) is None


def test_numbers_stay_where_an_effect_led_that_was_dropped(trapped: tuple[Setting, Fit, Fit]) -> None:
    setting, tuned, beside = trapped
    found = tuned_beside(setting, tuned, replace(beside, candidates=()))
    assert found is not None and score(found[1], False) < score(tuned, False)
