"""A loop is found where inputs answer the outputs, and in no open one, whatever is played and however it is bent."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from campaigns.facts import Fact, found_in
from campaigns.facts.loop import Answer, said
from campaigns.facts.regression import Regression, independent, triangle_of
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


@pytest.mark.parametrize("closed", [True, False])
def test_beside_a_reference_that_repeats_exactly_a_controller_is_found_too(closed: bool):
    """What differs between periods holds nothing of such a reference: its columns are zero, and explain nothing."""
    found = 0
    for case in range(6):
        rng = np.random.default_rng([78, case])
        period, colour = 600, float(rng.choice([0.0, 0.9, 0.99]))
        reference = np.tile(scipy.signal.lfilter([0.1], [1.0, -0.9], rng.standard_normal(period)), 8)
        noise = scipy.signal.lfilter([1.0], [1.0, -colour], rng.standard_normal(reference.size))
        noise *= 0.01 * reference.std() / noise.std()
        x, u, y = 0.0, np.empty(noise.size), np.empty(noise.size)
        for k in range(noise.size):
            y[k] = x + noise[k]
            u[k] = 3.0 * (reference[k] - (y[k] if closed else 0.0))
            x = 0.9 * x + 0.1 * u[k]
        read = u + (0.0 if closed else 1e-3 * u.std()) * rng.standard_normal(u.size)
        found += bool(told(read, y, period, reference).numbers.get("found"))
    assert found == (6 if closed else 0)


def test_columns_that_others_hold_explain_nothing_of_their_own():
    rng = np.random.default_rng(79)
    some = rng.standard_normal((50, 2))
    matrix = np.column_stack([some[:, 0], np.zeros(50), some[:, 1], some[:, 0] - 2.0 * some[:, 1]])
    assert independent(matrix).tolist() == [0, 2]
    target = some[:, 0] + rng.standard_normal(50)
    whole = Regression(
        triangle_of(np.column_stack([matrix, target])), np.zeros(4, dtype=int), np.zeros(4, dtype=int), 50, 0
    )
    groups = [np.arange(4) == k for k in range(4)]
    alone, both = (float(np.linalg.lstsq(some[:, :k], target)[1][0]) for k in (1, 2))
    assert whole.left(groups) == pytest.approx([alone, alone, both, both])


def test_a_share_that_is_no_proof_is_not_said_to_be_too_small_to_see():
    """Later inputs hold much of the output, and inputs farther past as much: an order that is too low does that."""
    answer = Answer("x", 0.4, 0.0, 0.4, 1000.0)
    assert answer.seen and not answer.found
    fact = said([answer], with_references=True)
    assert fact.numbers == {} and "not known" in fact.finding and "40 %" in fact.finding


def test_an_input_that_repeats_exactly_answers_nothing():
    rng = np.random.default_rng(74)
    u = np.tile(rng.standard_normal(500), 8)
    _, y = drawn.played(drawn.drawn_bench(rng, linear=True), u, rng)
    fact = told(u, y, 500)
    assert fact.numbers["found"] == 0 and "repeat exactly" in fact.finding
