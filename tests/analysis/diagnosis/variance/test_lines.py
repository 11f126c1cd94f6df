"""A vibration line is kept where there is one, and given up for a random band that explains as much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.discrepancy import discrepancy_of
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import Screen
from analysis.diagnosis.variance.lines import without_lines
from sim_backend.effects.vibration_line import VibrationLine
from tests.analysis.diagnosis.residuals import RATE_HZ, moved, setting_of
from tests.analysis.diagnosis.variance.test_broadband import N, _band, _noise


def _found(shake: np.ndarray, frequency_hz: float, period: int = 0) -> Found:
    """Return the outcome of a search that took `shake` for a line, and fitted one at its best frequency nearby."""
    rng = np.random.default_rng(3)
    force = np.repeat(rng.uniform(-1.0, 1.0, (period or N) // 400), 400)
    force = np.tile(force, N // force.size)
    reading = moved(force) + _noise(rng) + moved(shake)
    setting, _ = setting_of(force, reading, reading - moved(force), 0.012, period)
    starts = starts_of(setting.data, setting.nominal, setting.whitener)
    setting = replace(setting, starts=starts, states=(np.zeros((setting.nominal.n_blocks, 2)),))
    tuned = refit(setting, (), np.zeros(0), np.zeros(0))
    unit = {"cosine": 0.01, "sine": 0.01}
    trials = []
    for f in frequency_hz + np.array([-0.2, 0.05, 0.2]):
        line = Candidate(VibrationLine, "x", {"frequency_hz": float(f)}, unit, {"frequency_hz": frequency_hz})
        trials.append(refit(setting, (line,), np.array([0.3, 0.3]), np.zeros(0), exact=True))
    best = min(trials, key=lambda fit: fit.objective)
    none = np.zeros(0)
    screen = Screen((), none, none, (), (), none, none)
    worth = tuned.misfit - best.misfit
    return Found(setting, tuned, best, (tuned, best), screen, screen, worth, discrepancy_of(setting, tuned, best))


def test_a_line_stays() -> None:
    """One frequency that does not waver, some times as strong as the noise beside it."""
    found = _found(0.01 * np.sin(2.0 * np.pi * 30.05 * np.arange(N) / RATE_HZ), 30.0)
    assert found.explained > 100.0
    assert without_lines(found).best is found.best


def test_a_line_stays_that_repeats_nearly_with_the_excitation() -> None:
    """Of 30.01 Hz an eighth is in the difference of two periods of 12 s, in which alone a band would be seen."""
    found = _found(0.002 * np.sin(2.0 * np.pi * 30.01 * np.arange(N) / RATE_HZ), 29.96, N // 2)
    assert found.explained > 60.0
    assert without_lines(found).best is found.best


@pytest.mark.parametrize("period", [0, N // 2])
def test_a_random_band_is_no_line(period: int) -> None:
    """A line fitted into the strongest part of a band explains a good deal, and yet it goes."""
    shake = 0.01 * _band(np.random.default_rng(4), 30.0, 6.0)
    found = _found(shake, 30.0, period)
    assert found.explained > 50.0
    after = without_lines(found)
    assert after.best.candidates == ()
    assert after.best.misfit == pytest.approx(found.tuned.misfit, rel=1e-6)
    assert after.explained == 0.0
