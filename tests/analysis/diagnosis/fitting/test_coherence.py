"""What follows a drive by a linear law is told from what does not, whatever the law."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from analysis.diagnosis.fitting.discrepancy import following_of
from analysis.diagnosis.fitting.fit import linear_of
from tests.analysis.diagnosis.residuals import moved, setting_of

Array = NDArray[np.float64]

PERIOD, PERIODS = 2000, 5
BY_CHANCE = 0.05
"""Two numbers of H are fitted to 40 lines."""


def _forces(waveform: str) -> Array:
    rng = np.random.default_rng(6)
    if waveform == "noise":
        return rng.standard_normal(PERIOD * PERIODS)
    if waveform == "steps":
        return np.repeat(rng.uniform(-2.0, 2.0, PERIODS * 10), PERIOD // 10)
    if waveform == "two levels":
        return np.repeat(rng.choice([-1.0, 1.0], PERIODS * 10), PERIOD // 10)
    spectrum = np.zeros(PERIOD // 2 + 1, complex)
    spectrum[1:400] = np.exp(2j * np.pi * rng.random(399))
    wave = np.fft.irfft(spectrum, PERIOD)
    return np.tile(wave / wave.std(), PERIODS)


def _part(force: Array, change: Array) -> float:
    period = 0 if np.any(force[:PERIOD] != force[PERIOD : 2 * PERIOD]) else PERIOD
    setting, fit = setting_of(force, moved(force), change, 1e-3, period)
    return float(following_of(setting, linear_of(setting, fit), [change[:, None]])[0])


def _harmonics(force: Array) -> Array:
    """What a stiffening spring leaves once stiffness and gain are re-tuned: no part of it is the motion itself."""
    x = moved(force)
    cube = x**3
    return cube - x * (x @ cube) / (x @ x)


@pytest.mark.parametrize("waveform", ["multisine", "noise", "steps", "two levels"])
def test_another_linear_law_follows(waveform: str) -> None:
    force = _forces(waveform)
    lagged = lfilter([0.2], [1.0, -0.8], force)
    slower = lfilter([0.1], [1.0, -0.9], force)
    assert _part(force, moved(lagged - slower)) > 0.98


@pytest.mark.parametrize("waveform", ["multisine", "noise"])
def test_harmonics_do_not(waveform: str) -> None:
    force = _forces(waveform)
    assert _part(force, _harmonics(force)) < 0.5 * _part(force, moved(force))


def test_between_two_levels_a_spring_answers_like_another_linear_law() -> None:
    """Every step is the same but for its sign, and so is what a stiffening spring makes of it, once it has settled."""
    force = _forces("two levels")
    assert _part(force, _harmonics(force)) > 0.9


def test_of_noise_only_what_is_fitted_by_chance() -> None:
    rng = np.random.default_rng(8)
    force = _forces("noise")
    assert _part(force, rng.standard_normal(force.size)) < 1.5 * BY_CHANCE


def test_where_nothing_changes_all_does() -> None:
    force = _forces("noise")
    assert _part(force, np.zeros(force.size)) == 1.0
