"""Colour and level of noise that was made with known ones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.diagnosis.noise.autoregression import fit_ar
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.noise.levels import levels_of_means
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from tests.analysis.diagnosis.two_modes import RATE_HZ


def test_noise_colour_is_found_and_removed() -> None:
    rng = np.random.default_rng(1)
    noise = 3e-6 * lfilter([1.0], [1.0, -1.2, 0.5], rng.standard_normal(40_000))
    taps = fit_ar([(noise, np.ones(noise.size, dtype=bool))])
    # standard deviation of an AR coefficient is about sqrt(1 - rho²)/sqrt(n) < 0.005
    np.testing.assert_allclose(taps[:3] / taps[0], [1.0, -1.2, 0.5], atol=0.02)
    white = lfilter(taps, 1.0, noise)[100:]
    assert white.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * white.size))
    lag = np.array([np.mean(white[k:] * white[:-k]) for k in range(1, 11)])
    assert np.max(np.abs(lag)) < 5 / np.sqrt(white.size)


def test_noise_is_what_does_not_repeat() -> None:
    rng = np.random.default_rng(2)
    period, repeats = 500, 6
    error_of_the_model = np.tile(1e-3 * rng.standard_normal(period), repeats)
    residual = (error_of_the_model + 2e-6 * rng.standard_normal(period * repeats))[:, None]
    u = np.zeros_like(residual)
    record = Record("r", u, residual, (Window("p", 0, period * repeats, False, period),))
    whitener = whitener_from(Dataset(RATE_HZ, (record,)), [residual])
    assert whitener.repeats
    # 2000 differences: the standard deviation is known to 1.6 %, the order selection may use up a little
    assert 1 / whitener.taps[0, 0] == pytest.approx(2e-6, rel=0.06)


@pytest.mark.parametrize("records", [1, 2, 13, 25, 60])
def test_any_number_of_records_of_one_length_has_bands_with_a_width(records: int) -> None:
    rng = np.random.default_rng(5)
    period, size = 200, 2e-6
    rows = 2 * period
    residuals = [size * rng.standard_normal((rows, 1)) for _ in range(records)]
    made = [
        Record(str(k), np.zeros((rows, 1)), r, (Window("p", 0, rows, False, period),)) for k, r in enumerate(residuals)
    ]
    whitener = whitener_from(Dataset(RATE_HZ, tuple(made)), residuals)
    assert np.all(np.diff(whitener.edges) > 0.0)
    levels = whitener.band_levels(rows, 0)
    assert np.all(np.isfinite(levels)) and np.all(levels > 0.0)
    # white noise is as loud down there as anywhere, as far as two periods know it
    white = np.concatenate([whitener.rows(r, m.fitted(), 0) for r, m in zip(residuals, made, strict=True)])
    assert 0.5 < np.mean(white**2) < 1.6


def _spectra(rng: np.random.Generator, rows: int, level: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and powers of so many rows of noise between 0.01 and 0.015 cycles per sample, and many above."""
    frequency = np.concatenate([np.linspace(0.01, 0.0149, rows), np.linspace(0.0151, 0.5, 50 * rows)])
    return frequency, level * rng.standard_normal(frequency.size) ** 2


def test_a_level_that_few_rows_of_noise_tell_is_told_by_what_is_left_too() -> None:
    """24 rows know it to 29 %, the median of 120 others to 21 %, both together to 17 %."""
    rng = np.random.default_rng(6)
    found = []
    for _ in range(400):
        edges, levels = levels_of_means([_spectra(rng, 24)], 0.01, [_spectra(rng, 120)])
        found.append(levels[0, 0])
    assert edges[0] == pytest.approx(0.015, rel=0.02)
    # the deviation of 400 draws is itself known to 4 %
    assert np.std(found) == pytest.approx(1.0 / np.sqrt(12.0 + 0.37 * 60.0), rel=0.15)
    assert np.mean(found) == pytest.approx(1.0, abs=0.05)


def test_an_error_of_the_model_is_no_noise() -> None:
    """Where more is left than the rows of noise may err by, they alone tell; lines in a few rows do not count."""
    rng = np.random.default_rng(7)
    alone, lines = [], []
    for _ in range(100):
        noise, left = _spectra(rng, 24), _spectra(rng, 120)
        own = float(np.mean(noise[1][:24]))
        alone.append(levels_of_means([noise], 0.01, [_spectra(rng, 120, 30.0)])[1][0, 0] == own)
        spiked = left[1].copy()
        spiked[:120:12] = 1e4
        lines.append(levels_of_means([noise], 0.01, [(left[0], spiked)])[1][0, 0])
    assert all(alone)
    assert np.mean(lines) < 1.25
