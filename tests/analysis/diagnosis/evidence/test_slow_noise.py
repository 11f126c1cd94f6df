"""Slow noise that the filter is too short for: it is no evidence, and what is evidence still shows beside it."""

import numpy as np
import pytest
from scipy.fft import dct
from scipy.signal import lfilter
from scipy.stats import binom

from analysis.diagnosis.evidence.domains import evidence
from analysis.diagnosis.evidence.slow_noise import excess_of_indicators, first_of_fast, levelled
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, flicker, moved

PERIOD, PERIODS = 1500, 8


def campaign(rng):
    """A record of repeated random motion that warms by a kelvin, in noise that rises as flicker below 5 Hz."""
    n = PERIOD * PERIODS
    force = np.tile(lfilter([1.0], [1.0, -0.9], rng.standard_normal(PERIOD)), PERIODS)
    residual = 1e-2 * flicker(rng, n)
    reading = (moved(force) + residual)[:, None]
    windows = (Window("all", 0, n, False, PERIOD),)
    record = Record("run", force[:, None], reading, windows, np.linspace(290.0, 291.0, n))
    return Dataset(RATE_HZ, (record,)), [residual[:, None]]


def test_slow_noise_is_significant_as_often_as_the_p_value_says():
    trials = 40
    found: dict[str, list[float]] = {}
    for seed in range(trials):
        data, residuals = campaign(np.random.default_rng(seed))
        for name, curves in evidence(data, residuals, whitener_from(data, residuals), MODEL).items():
            found.setdefault(name, []).extend(d.p_value for d in curves)
    assert all(len(found[name]) == trials for name in ("time", "temperature", "position", "rate", "amplitude"))
    # seven domains are looked at, so each may fail in 1 of 1000 x 7 runs
    limit = binom.ppf(1.0 - 1e-3 / 7, trials, 0.05)
    often = {name: int(np.sum(np.array(p) < 0.05)) for name, p in found.items()}
    assert {name: count for name, count in often.items() if count > limit} == {}


@pytest.mark.parametrize(
    ("domain", "error"),
    [
        ("time", lambda share: 60.0 * (share - 0.5)),
        ("time", lambda share: np.where((share > 0.6) & (share < 0.7), 8.0, 0.0)),
        ("temperature", lambda share: 60.0 * (share - 0.5)),
    ],
)
def test_what_is_far_above_slow_noise_is_evidence(domain, error):
    """The noise is that of a bench without it; one that always drifts so has that for noise."""
    data, residuals = campaign(np.random.default_rng(77))
    whitener = whitener_from(data, residuals)
    residuals[0][:, 0] += 1e-2 * error(np.linspace(0.0, 1.0, residuals[0].shape[0]))
    (curve,) = evidence(data, residuals, whitener, MODEL)[domain]
    assert curve.p_value < 1e-3


def test_levelled_normal_equations_are_those_of_levelled_indicators():
    rng = np.random.default_rng(4)
    n, bins = 480, 11
    index, taps, levels = rng.integers(-1, bins, size=n), np.array([1.3, -0.7, 0.2]), np.linspace(9.0, 1.2, 40)
    dense = lfilter(taps, [1.0], (index[:, None] == np.arange(bins)).astype(float), axis=0)
    direct = levelled(dense, levels)
    ours = dense.T @ dense - excess_of_indicators(taps, index, bins, levels)
    np.testing.assert_allclose(ours, direct.T @ direct, atol=1e-10)
    w = rng.standard_normal(n)
    np.testing.assert_allclose(
        dense.T @ levelled(levelled(w, levels), levels), direct.T @ levelled(w, levels), atol=1e-10
    )


def test_levels_make_noise_of_that_colour_white():
    rng = np.random.default_rng(6)
    levels = np.array([100.0, 30.0, 10.0, 3.0])
    rows = rng.standard_normal((2000, 64))
    rows[:, :4] *= np.sqrt(levels)
    series = dct(rows, axis=1, norm="ortho", type=3)
    white = levelled(series.T, levels).T
    # 2000 numbers give a variance to 3.2 %, of 64 the worst is within four of these
    np.testing.assert_allclose(np.var(dct(white, axis=1, norm="ortho"), axis=0), 1.0, atol=0.13)
    np.testing.assert_array_equal(levelled(series, np.zeros(0)), series)


@pytest.mark.parametrize(("n", "order"), [(48_000, 18), (48_000, 0), (997, 5), (60, 9), (20_011, 400)])
def test_few_rows_are_left_out_for_a_length_that_is_fast(n, order):
    first = first_of_fast(n, order)
    assert order <= first <= order + max(0.01 * n, 4)
