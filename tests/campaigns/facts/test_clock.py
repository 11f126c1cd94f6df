"""Two clocks that differ are told from everything else that drifts, with by how much."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.facts import Fact, found_in
from campaigns.facts.blocks import Blocks
from campaigns.facts.clock import drift_of
from tests.campaigns.facts import drawn

KINDS = ("white", "coloured", "steps", "multisine", "repeated noise")


def told(u: np.ndarray, y: np.ndarray, period: int = 0) -> Fact | None:
    facts = [f for f in found_in(drawn.seen(u, y, period), ["clock"]) if f.name == "clock"]
    return facts[0] if facts else None


def read_by(y: np.ndarray, ppm: float) -> np.ndarray:
    """Return readings (n,) by a clock so much slower, from a spline through all of them."""
    from scipy.interpolate import CubicSpline

    at = np.arange(y.size)
    return np.asarray(CubicSpline(at, y)(np.minimum(at * (1.0 + 1e-6 * ppm), y.size - 1.0)))


@pytest.mark.parametrize("part", range(4))
def test_one_clock_is_never_called_two(part):
    wrong = []
    for case in range(part, 200, 4):
        rng = np.random.default_rng([91, case])
        bench = drawn.drawn_bench(rng, delay=int(rng.integers(0, 6)))
        u, period = drawn.excitation(rng, KINDS[case // 4 % 5], int(10 ** rng.uniform(3.3, 4.0)))
        fact = told(u, drawn.played(bench, u, rng)[1], period)
        if fact is not None and fact.numbers["found"]:
            wrong.append((case, fact.finding))
    assert wrong == []


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("ppm", [100.0, -500.0])
def test_two_clocks_are_told_with_their_difference(kind, ppm):
    """100 ppm of 20000 samples are two samples at the end, which a record of 1 % noise shows."""
    for case in range(3):
        rng = np.random.default_rng([92, case])
        bench = drawn.Bench(np.array([0.2, 0.5]), np.array([0.1, 0.05]), np.ones(2), 2, 0.01, 0.0, 0.0, 0.0)
        u, period = drawn.excitation(rng, kind, 20_000)
        fact = told(u, read_by(drawn.played(bench, u, rng)[1], ppm), period)
        assert fact is not None and fact.numbers["found"] and fact.remark
        # five standard deviations, and the hundredth that readings between samples and few blocks cost
        assert fact.numbers["ppm"] == pytest.approx(ppm, abs=5.0 * fact.numbers["std_ppm"] + 0.01 * abs(ppm))


@pytest.mark.parametrize("kind", KINDS)
def test_a_resonance_that_softens_is_no_clock(kind):
    import scipy

    rng = np.random.default_rng(93)
    u, period = drawn.excitation(rng, kind, 20_000)
    ends = []
    for omega in (0.30, 0.29):
        bench = drawn.Bench(np.array([omega]), np.array([0.05]), np.ones(1), 1, 0.0, 0.0, 0.0, 0.0)
        ends.append(drawn.played(bench, u, rng, disturbance=1e-3 * rng.standard_normal(u.size))[1])
    share = scipy.special.expit(np.linspace(-2.0, 2.0, u.size))
    fact = told(u, (1.0 - share) * ends[0] + share * ends[1], period)
    assert fact is None or not fact.numbers["found"]


def test_a_line_of_its_own_frequency_is_no_clock():
    rng = np.random.default_rng(94)
    u = np.tile(rng.standard_normal(1000), 20)
    y = drawn.played(drawn.drawn_bench(rng, linear=True), u, rng)[1]
    fact = told(u, y + y.std() * np.sin(2.0 * np.pi * 0.05013 * np.arange(u.size)), 1000)
    assert fact is None or not fact.numbers["found"]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_slow_bins_that_drift_are_no_clock_where_the_fast_ones_stay(seed: int):
    """Friction or free play turn the strongest, slowest motion; a clock would turn the fast bins far more."""
    rng = np.random.default_rng(seed)
    blocks, bins, length = 69, 63, 126
    start, line = np.arange(blocks) * length, np.arange(1, bins + 1)
    noise = rng.standard_normal((2, blocks, bins))
    z = 1.0 + 2.0 * (noise[0] + 1j * noise[1])
    for k, size in ((0, 100.0), (1, 25.0)):
        turned = -8e-4 * 2.0 * np.pi * line[k] / length * start
        z[:, k] = size * np.exp(1j * (turned + 5.0 / size * rng.standard_normal(blocks)))
    played = np.ones((blocks, bins, 1), dtype=complex)
    drift = drift_of(z, Blocks(played, z[:, :, None], line, length, start, np.zeros(blocks, dtype=int)))
    assert drift is not None and not drift.found and abs(drift.relative) < 1e-4
