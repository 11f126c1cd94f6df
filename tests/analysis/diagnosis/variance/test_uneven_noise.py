"""Noise that grows with the angle: found, told from its rivals, and not found where noise is even."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from analysis.diagnosis.variance.uneven_noise import score_test, uneven_noise
from tests.analysis.diagnosis.residuals import RATE_HZ, moved, setting_of

N = 16_000


def _force(rng: np.random.Generator) -> np.ndarray:
    """Steps and a fast part, so that position, rate and command are not the same thing."""
    steps = np.repeat(rng.uniform(-1.0, 1.0, N // 400), 400)
    return np.asarray(steps + 0.3 * np.sin(2.0 * np.pi * 60.0 * np.arange(N) / RATE_HZ))


def _case(seed: int, linear: float, quadratic: float = 0.0, by_rate: float = 0.0):
    rng = np.random.default_rng(seed)
    force = _force(rng)
    x = moved(force)
    rate = np.gradient(x)
    noise = 0.01 * rng.standard_normal(N)
    noise += (linear * np.abs(x) + quadratic * x**2) * rng.standard_normal(N)
    noise += by_rate * rate * rng.standard_normal(N)
    return setting_of(force, x + noise, noise, float(np.std(noise)))


@pytest.mark.parametrize(("linear", "quadratic"), [(0.01, 0.0), (0.0, 0.02), (0.03, 0.0)])
def test_its_size_is_found(linear: float, quadratic: float) -> None:
    """The mean of eight estimates is within three of its standard deviations, and their scatter is as they say."""
    off = []
    for seed in range(8):
        (cause,) = uneven_noise(*_case(seed, linear, quadratic))
        assert cause.p_value < 1e-4
        assert cause.evidence > 10.0
        name, truth = ("linear", linear) if linear else ("quadratic", quadratic)
        if set(cause.std) == {name}:
            off.append((getattr(cause.effect, name) - truth) / cause.std[name])
    # a law with both terms may win by chance, or the other one near the limit
    assert len(off) >= 6
    assert abs(np.mean(off)) < 3.0 / np.sqrt(len(off))
    # the 0.1 % points of chi-square over its degrees of freedom lie below 3.6 for six and more
    assert np.mean(np.square(off)) < 3.6


def test_even_noise_raises_no_alarm() -> None:
    """Of a hundred, about as many p-values below 5 % as there should be (99.9 % of a binomial), none below 1e-5."""
    values = []
    for seed in range(100):
        found = uneven_noise(*_case(1000 + seed, 0.0))
        values.append(found[0].p_value if found else 1.0)
    # two columns are tried and the smaller p-value counts twice, so the rate is at most 5 %
    assert np.sum(np.array(values) < 0.05) <= binom.ppf(0.999, 100, 0.05)
    assert min(values) > 1e-5


def test_noise_that_grows_with_the_rate_is_not_taken_for_it() -> None:
    """The rate's law is then far ahead, so that the cause cannot be sure."""
    for seed in range(5):
        found = uneven_noise(*_case(seed, 0.0, by_rate=0.2))
        assert all(min(gap for _, gap in c.rivals) < -10.0 for c in found)


def test_an_error_of_the_model_is_not_taken_for_it() -> None:
    """A residual that goes with the position is not white: it is missing above a quarter of the sample rate."""
    rng = np.random.default_rng(5)
    force = _force(rng)
    x = moved(force)
    residual = 0.01 * rng.standard_normal(N) + 0.05 * x**3
    assert all(c.p_value > 1e-3 for c in uneven_noise(*setting_of(force, x + residual, residual, 0.02)))


def test_the_score_is_uniform_for_heavy_tails() -> None:
    """Studentised, it holds its level for energies of any distribution: Kolmogorov's distance at 0.1 %."""
    rng = np.random.default_rng(6)
    column = rng.random(800)
    p = np.sort([score_test(rng.standard_t(6, 800) ** 2, column) for _ in range(400)])
    assert np.max(np.abs(p - (np.arange(400) + 0.5) / 400.0)) < 1.95 / np.sqrt(400.0)
