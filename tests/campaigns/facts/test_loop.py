"""A loop is found where inputs answer the outputs, and in no open one, whatever is played and however it is bent."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from campaigns.facts import Fact, found_in
from tests.campaigns.facts import drawn

NULLS = 204


def told(u: np.ndarray, y: np.ndarray, period: int = 0, reference: np.ndarray | None = None) -> Fact:
    (fact,) = [f for f in found_in(drawn.seen(u, y, period, reference), ["closed-loop"]) if f.name == "closed-loop"]
    return fact


@pytest.mark.parametrize("part", range(4))
def test_no_open_loop_is_called_closed(part):
    wrong = []
    for case in range(part, NULLS, 4):
        rng = np.random.default_rng([76, case])
        bench = drawn.drawn_bench(rng, delay=int(rng.integers(0, 6)))
        kind = drawn.EXCITATIONS[case // 4 % len(drawn.EXCITATIONS)]
        u, period = drawn.excitation(rng, kind, int(10 ** rng.uniform(3.3, 3.8)))
        _, y = drawn.played(bench, u, rng)
        measured = u + rng.choice([0.0, 0.01]) * rng.standard_normal(u.size)  # an input that was measured
        if told(measured, y, period).numbers.get("found"):
            wrong.append((case, kind))
    assert wrong == []


@pytest.mark.parametrize("kind", ["white", "coloured", "steps", "multisine", "repeated noise"])
def test_a_loop_that_moves_much_of_the_input_is_found(kind):
    """A disturbance of six times the motion, through a loop of gain 0.3: white inputs hold a tenth of it."""
    found = 0
    for case in range(10):
        rng = np.random.default_rng([72, case])
        bench = drawn.Bench(np.array([rng.uniform(0.1, 0.4)]), np.array([0.5]), np.ones(1), 1, 0.01, 0.0, 0.0, 0.0)
        u, period = drawn.excitation(rng, kind, 6000)
        acted, y = drawn.played(bench, u, rng, feedback=0.3, disturbance=6.0 * rng.standard_normal(u.size))
        assert (acted - u).std() < 2.0  # the loop is stable
        found += bool(told(acted, y, period).numbers.get("found"))
    assert found >= 8


@pytest.mark.parametrize("kind", ["white", "coloured", "steps", "chirp"])
def test_with_its_reference_a_loop_is_found_by_the_noise_of_the_sensor(kind):
    found = 0
    for case in range(10):
        rng = np.random.default_rng([73, case])
        bench = drawn.drawn_bench(rng, linear=True)
        u, _ = drawn.excitation(rng, kind, 6000)
        acted, y = drawn.played(bench, u, rng, feedback=0.5)
        found += bool(told(acted, y, 0, u).numbers.get("found"))
    assert found >= 8


@pytest.mark.parametrize("closed", [True, False])
@pytest.mark.parametrize("colour", [[1.0], [1.0, -0.995]], ids=["white", "drifting"])
def test_a_controller_that_answers_within_its_sample_is_found_by_its_reference(closed: bool, colour: list[float]):
    """All of a reading's noise is then in the input of that sample; without the loop the input has noise of its own."""
    found = 0
    for case in range(6):
        rng = np.random.default_rng([77, case])
        noise = 0.1 * scipy.signal.lfilter([1.0], colour, rng.standard_normal(5000))
        reference = scipy.signal.lfilter([0.1], [1.0, -0.9], rng.standard_normal(noise.size))
        x, u, y = 0.0, np.empty(noise.size), np.empty(noise.size)
        for k in range(noise.size):
            y[k] = x + noise[k]
            u[k] = 3.0 * (reference[k] - (y[k] if closed else 0.0))
            x = 0.9 * x + 0.1 * u[k]
        read = u + (0.0 if closed else 0.01) * rng.standard_normal(u.size)
        found += bool(told(read, y, 0, reference).numbers.get("found"))
    assert found == (6 if closed else 0)


def test_an_input_that_repeats_exactly_answers_nothing():
    rng = np.random.default_rng(74)
    u = np.tile(rng.standard_normal(500), 8)
    _, y = drawn.played(drawn.drawn_bench(rng, linear=True), u, rng)
    fact = told(u, y, 500)
    assert fact.numbers["found"] == 0 and "repeat exactly" in fact.finding
