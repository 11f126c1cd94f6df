"""How long a record takes to repeat is told where it began in another motion, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.facts import Fact, found_in
from tests.campaigns.facts import drawn

PERIOD = 1000


def told(u: np.ndarray, y: np.ndarray) -> Fact:
    (fact,) = [f for f in found_in(drawn.seen(u, y, PERIOD), ["transient"]) if f.name == "transient"]
    return fact


def repeated(
    rng: np.random.Generator, damping: float, lead: int, noise: float, colour: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return six periods of a mode at a twentieth of the rate, begun so many periods before."""
    bench = drawn.Bench(np.array([0.3]), np.array([damping]), np.ones(1), 0, noise, colour, 0.0, 0.0)
    u = np.tile(rng.standard_normal(PERIOD), 6 + lead)
    y = drawn.played(bench, u, rng)[1]
    return u[lead * PERIOD :], y[lead * PERIOD :]


@pytest.mark.parametrize("part", range(2))
def test_a_record_that_repeats_from_its_start_has_none(part):
    """Noise that wanders for a tenth of a period leaves few independent numbers: one of a hundred may fail."""
    wrong = []
    for case in range(part, 200, 2):
        rng = np.random.default_rng([111, case])
        colour = float(rng.choice([0.0, 0.9, 0.99]))
        u, y = repeated(rng, 10.0 ** rng.uniform(-1.5, -0.3), 3, 10.0 ** rng.uniform(-3.0, -1.0), colour)
        if told(u, y).numbers["segments"]:
            wrong.append(case)
    assert len(wrong) <= 1, wrong


@pytest.mark.parametrize("damping", [0.01, 0.03, 0.1])
def test_a_start_from_rest_lasts_until_it_is_below_the_noise(damping):
    rng = np.random.default_rng(112)
    noise = 0.01
    u, y = repeated(rng, damping, 0, noise)
    fact = told(u, y)
    # the free motion starts as large as the output and decays by damping times 0.3 per sample
    expected = np.log(1.0 / noise) / (0.3 * damping)
    assert fact.numbers["segments"] == 1 and not fact.remark
    assert 0.3 * expected < fact.numbers["rows"] < 1.5 * expected + 4 * PERIOD / 32


def test_a_motion_that_rings_through_most_of_the_record_is_remarked():
    rng = np.random.default_rng(113)
    fact = told(*repeated(rng, 0.001, 0, 0.001))
    assert fact.remark and "at least" in fact.finding
