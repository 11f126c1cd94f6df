import numpy as np
import pytest
from scipy import signal
from scipy.stats import binom

from analysis.identification.validation import input_correlation, relative_error, whiteness
from sim_backend.errors import DataError


def test_relative_error_of_known_signals(rng):
    y = np.stack([np.sin(np.linspace(0.0, 20.0 * np.pi, 4000, endpoint=False)) + 3.0] * 2, axis=1)
    got = relative_error(y, y + np.array([0.1, -0.2]))
    # a sine's rms is 1 / sqrt(2)
    assert np.allclose(got.per_channel, np.array([0.1, 0.2]) * np.sqrt(2.0), rtol=1e-6)
    assert got.total == pytest.approx(0.15 * np.sqrt(2.0), rel=1e-6)
    with pytest.raises(DataError, match="channel 1 is constant"):
        relative_error(y * np.array([1.0, 0.0]), y)


def test_p_values_are_uniform_under_the_null_and_small_otherwise(rng):
    white, crossed = [], []
    for _ in range(200):
        u = signal.lfilter([1.0], [1.0, -0.9], rng.normal(size=1500))
        e = signal.lfilter([1.0], [1.0, 0.8], rng.normal(size=1500))
        white.append(whiteness(rng.normal(size=600)).p_value < 0.05)
        crossed.append(input_correlation(e, u).p_value < 0.05)
    low, high = binom.ppf([1e-4, 1.0 - 1e-4], 200, 0.05)
    assert low <= sum(white) <= high
    assert low <= sum(crossed) <= high
    e = signal.lfilter([1.0], [1.0, -0.5], rng.normal(size=600))
    assert whiteness(e).p_value < 1e-6
    assert input_correlation(e + 0.3 * np.roll(u[:600], 4), u[:600]).p_value < 1e-6


def test_what_is_too_short_is_refused_with_its_own_reason(rng):
    e = rng.normal(size=60)
    with pytest.raises(DataError, match="has 60 samples, 30 lags need more than 60"):
        whiteness(e, lags=30)
    with pytest.raises(DataError, match="lags is 5 with 5 fitted"):
        whiteness(e, lags=5, fitted=5)
    with pytest.raises(DataError, match="fewer lags"):
        input_correlation(e, e, lags=15)
    with pytest.raises(DataError, match="the input of the same samples"):
        input_correlation(e, e[1:], lags=5)
