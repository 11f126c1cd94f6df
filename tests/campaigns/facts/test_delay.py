"""The delay of a pair is told where its first answer stands out of the noise, and never wrongly."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.facts import Fact, found_in
from tests.campaigns.facts import drawn


def told(u: np.ndarray, y: np.ndarray) -> list[Fact]:
    return [f for f in found_in(drawn.seen(u, y), ["delay"]) if f.name == "delay"]


@pytest.mark.parametrize("part", range(4))
def test_what_is_told_is_right_whatever_resonates_and_bends(part):
    """A held input first moves a mode one sample after; 200 records, modes up to a fifth of the rate."""
    wrong, right = [], 0
    for case in range(part, 200, 4):
        rng = np.random.default_rng([85, case])
        bench = drawn.drawn_bench(rng, delay=int(rng.integers(0, 9)))
        u, _ = drawn.excitation(rng, ("white", "coloured", "steps", "chirp")[case // 4 % 4], 5000)
        _, y = drawn.played(bench, u, rng)
        for fact in told(u, y):
            if "first" in fact.numbers:
                right += fact.numbers["first"] == bench.delay + 1
                if fact.numbers["first"] != bench.delay + 1:
                    wrong.append((case, bench.delay, fact.finding))
            elif fact.numbers.get("most", bench.delay) < bench.delay:
                wrong.append((case, bench.delay, fact.finding))
    assert wrong == [] and right >= 10


def test_a_delay_of_white_noise_is_found_at_one_per_cent_of_noise():
    for delay in (0, 1, 5, 10):
        rng = np.random.default_rng([82, delay])
        bench = drawn.Bench(np.array([0.3]), np.array([0.05]), np.array([1.0]), delay, 0.01, 0.0, 0.0, 0.0)
        u = rng.standard_normal(5000)
        (fact,) = told(u, drawn.played(bench, u, rng)[1])
        assert fact.numbers["first"] == delay + 1 and fact.remark is (delay >= 1)
        assert fact.numbers["samples"] == pytest.approx(delay + 0.5)
        assert fact.numbers["s"] == pytest.approx((delay + 0.5) / drawn.RATE_HZ)


def test_each_input_has_its_own_delay():
    rng = np.random.default_rng(83)
    u = rng.standard_normal((6000, 2))
    y = sum(
        drawn.played(drawn.Bench(np.array([w]), np.array([0.1]), np.ones(1), d, 0.003, 0.0, 0.0, 0.0), u[:, j], rng)[1]
        for j, (w, d) in enumerate(((0.3, 2), (0.2, 5)))
    )
    assert [fact.numbers["first"] for fact in told(u, np.asarray(y))] == [3, 6]


def test_a_sweep_tells_no_sample_from_the_next():
    rng = np.random.default_rng(84)
    u, _ = drawn.excitation(rng, "chirp", 5000)
    (fact,) = told(u, drawn.played(drawn.drawn_bench(rng, linear=True, delay=3), u, rng)[1])
    assert "not known" in fact.finding and not fact.remark
