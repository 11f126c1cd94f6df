"""What the interactive plots of a diagnosis draw, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.diagnosis.answer.explore import density, distinct, noise_density
from analysis.diagnosis.noise.whitener import Whitener

RATE_HZ = 1000.0


def test_the_density_of_white_noise_is_flat_and_a_tone_keeps_its_power():
    rng = np.random.default_rng(0)
    f, level = density(2.0 * rng.standard_normal(200_000) + 50.0, RATE_HZ)
    # one-sided: variance over half the rate. Above 30 Hz a band has ten lines and more of 48 half-overlapping
    # stretches: 5 % (1 sigma) at most, four times that
    assert level[f > 30.0] == pytest.approx(2.0 * np.sqrt(2.0 / RATE_HZ), rel=0.2)
    assert np.mean(level[f > 100.0]) == pytest.approx(2.0 * np.sqrt(2.0 / RATE_HZ), rel=0.01)
    t = np.arange(200_000) / RATE_HZ
    f, level = density(3.0 * np.sin(2.0 * np.pi * 125.0 * t), RATE_HZ)
    assert f[np.argmax(level)] == pytest.approx(125.0, rel=0.04)  # sixty bands per decade are 3.9 % wide
    assert f[0] < 0.2 and f[-1] > 480.0


def test_the_noise_has_the_density_that_its_filter_and_its_levels_say():
    # x = w + 0.9 x before it: |1 / (1 - 0.9 exp(-j omega))|² at 2 w's density
    taps = np.array([[0.5, -0.45]])
    f, level = noise_density(Whitener(taps, True), 0, RATE_HZ, 4096)
    expected = 2.0 * np.sqrt(2.0 / RATE_HZ) / np.abs(1.0 - 0.9 * np.exp(-2j * np.pi * f / RATE_HZ))
    assert level == pytest.approx(expected, rel=0.02)  # the mean over a band of 3.9 %
    stronger = Whitener(taps, True, np.array([0.0, 0.01]), np.array([[4.0]]))
    ratio = noise_density(stronger, 0, RATE_HZ, 4096)[1] / level
    assert ratio[f < 9.5] == pytest.approx(2.0) and ratio[f > 10.5] == pytest.approx(1.0)


def test_noise_and_density_agree_on_the_same_series():
    rng = np.random.default_rng(1)
    x = lfilter([2.0], [1.0, -0.9], rng.standard_normal(400_000))
    f, level = density(x, RATE_HZ)
    g, noise = noise_density(Whitener(np.array([[0.5, -0.45]]), True), 0, RATE_HZ, 8192)
    seen = f > 30.0
    # 97 stretches and ten lines a band: 3.2 % (1 sigma) at most, four times that
    assert level[seen] == pytest.approx(np.interp(f[seen], g, noise), rel=0.13)


def test_names_that_occur_again_can_be_told_apart():
    assert distinct(["a", "a", "b", "a", "a (2)"]) == ["a", "a (2)", "b", "a (3)", "a (2)′"]
