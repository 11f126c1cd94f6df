"""Intervals against tables, closed forms and known samples."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest, norm, quantile_test

from analysis.challenge.intervals import bootstrap_interval, half_points, quantile_interval
from analysis.diagnosis.tails import share_interval


@pytest.mark.parametrize(("hits", "n"), [(0, 20), (20, 20), (7, 20), (3, 300), (299, 300)])
def test_share_interval_is_that_of_scipys_exact_test(hits: int, n: int) -> None:
    expected = binomtest(hits, n).proportion_ci(0.95, method="exact")
    assert share_interval(hits, n) == pytest.approx((expected.low, expected.high), abs=1e-9)


def test_nothing_counted_tells_nothing() -> None:
    assert share_interval(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize(("n", "part"), [(6, 0.5), (40, 0.5), (36, 0.9), (300, 0.9)])
def test_quantile_interval_is_that_of_scipys_exact_test(n: int, part: float) -> None:
    values = np.random.default_rng(2).exponential(size=n)
    expected = quantile_test(values, p=part).confidence_interval(0.95)
    assert quantile_interval(list(values), part) == pytest.approx((expected.low, expected.high))


@pytest.mark.parametrize(("n", "part"), [(0, 0.5), (5, 0.5), (35, 0.9)])
def test_too_few_values_have_no_quantile_interval(n: int, part: float) -> None:
    # all of five lie on one side of their median once in 16 times, all of 35 below the 90th percentile once in 40
    assert quantile_interval(list(range(n)), part) is None


def test_bootstrap_of_a_mean_has_the_width_of_theory() -> None:
    rng = np.random.default_rng(0)
    groups = [rng.normal(5.0, 2.0, 1) for _ in range(400)]
    low, high = bootstrap_interval(groups, lambda x: float(np.mean(x)), rng)
    # standard error 2/√400 = 0.1; its estimate scatters by 1/√800, the quantiles of 2000 draws by a few per cent
    assert high - low == pytest.approx(2 * 1.96 * 0.1, rel=0.15)
    assert low < 5.1
    assert high > 4.9


def test_cases_are_resampled_whole() -> None:
    rng = np.random.default_rng(0)
    # a hundred equal numbers of one case are one piece of knowledge, not a hundred
    groups = [np.full(100, value) for value in rng.normal(0.0, 1.0, 50)]
    low, high = bootstrap_interval(groups, lambda x: float(np.mean(x)), rng)
    assert high - low == pytest.approx(2 * 1.96 / np.sqrt(50), rel=0.3)


def test_half_points_come_back() -> None:
    rng = np.random.default_rng(1)
    true, slope = np.array([0.8, 1.0, 1.6]), 3.0
    sizes = [np.exp(rng.uniform(np.log(0.3), np.log(5.0), 400)) for _ in true]
    seen = [rng.random(400) < norm.cdf(slope * np.log(s / t)) for s, t in zip(sizes, true, strict=True)]
    # about a third of the cases lie where the chance changes: each tells ln s_half to about 1/slope, so 0.33/√130 = 3
    # %; four of them
    assert half_points(sizes, seen) == pytest.approx(true, rel=0.12)


def test_half_points_stay_finite_where_all_or_nothing_was_seen() -> None:
    sizes = [np.array([0.5, 1.0, 2.0])] * 2
    found = half_points(sizes, [np.ones(3, dtype=bool), np.zeros(3, dtype=bool)])
    assert 0.0 < found[0] < 0.5
    assert 2.0 < found[1] < 1000.0
