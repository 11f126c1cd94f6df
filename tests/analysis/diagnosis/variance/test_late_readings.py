"""Samples that were lost before the noise was added: distinguished from a delay, jitter and outliers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from analysis.diagnosis.variance.chance import Chance
from analysis.diagnosis.variance.late_readings import late_readings
from tests.analysis.diagnosis.residuals import flicker, setting_of

N = 8_000
SWING = 60.0
TRUE = SWING * np.sin(np.arange(N) / 15.0)
"""Moves by up to four times the noise in a sample; where it is no more than the noise, a loss passes for a delay."""

ALARM = 7.0
"""Evidence (natural logarithm) above which one of ten tests would name it."""

Noise = Callable[[np.random.Generator, int], np.ndarray]


def white(rng: np.random.Generator, n: int) -> np.ndarray:
    return rng.standard_normal(n)


def reading_of(rng: np.random.Generator, share: float, noise: Noise = white) -> np.ndarray:
    lost = rng.random(N) < share
    kept = np.maximum.accumulate(np.where(lost, 0, np.arange(N)))
    return TRUE[kept] + noise(rng, N)


def found(reading: np.ndarray) -> list[Chance]:
    return late_readings(*setting_of(np.zeros(N), reading, reading - TRUE, 1.0))


@pytest.mark.parametrize("noise", [white, flicker])
@pytest.mark.parametrize("share", [0.05, 0.2])
def test_the_share_of_lost_samples_is_found_beneath_noise(share: float, noise: Noise) -> None:
    """On average of ten records, in units of the stated deviation, which so many records narrow by the root of ten."""
    off = []
    for seed in range(10):
        (cause,) = found(reading_of(np.random.default_rng(seed), share, noise))
        assert cause.evidence > ALARM, f"seed {seed}"
        off.append((cause.effect.values()[0] - share) / cause.std["fraction"])
    assert abs(np.mean(off)) < 3.0 / np.sqrt(10.0)
    assert np.std(off) < 2.0


def test_noise_that_hides_the_steps_of_a_reading_shows_lost_samples_beneath_both():
    """Where the steps are larger than the noise, their error follows the motion, and nothing is said."""
    rng = np.random.default_rng(70)
    reading = reading_of(rng, 0.1)
    (cause,) = found(0.9 * np.rint(reading / 0.9))
    assert cause.evidence > ALARM and cause.effect.values()[0] == pytest.approx(0.1, abs=3.0 * cause.std["fraction"])
    assert found(3.0 * np.rint(reading / 3.0)) == []


@pytest.mark.parametrize("tails", ["normal", "outliers", "counts"])
def test_nothing_is_late_in_sixty_records_of_noise_alone(tails: str) -> None:
    """Nor where one row in fifty stands out by five times the noise."""
    for seed in range(60):
        rng = np.random.default_rng(500 + seed)
        reading = TRUE + rng.standard_normal(N)
        if tails == "outliers":
            reading += np.where(rng.random(N) < 0.02, 5.0 * rng.standard_normal(N), 0.0)
        if tails == "counts":
            reading = 0.9 * np.rint(reading / 0.9)
        assert all(c.evidence < ALARM for c in found(reading)), f"seed {seed}"


@pytest.mark.parametrize("kind", ["delay", "jitter"])
def test_what_makes_all_rows_late_is_no_loss(kind: str) -> None:
    """By a fifth of a sample, or by as much at random: one row in a hundred is half a sample late."""
    for seed in range(20):
        rng = np.random.default_rng(900 + seed)
        late = 0.2 if kind == "delay" else 0.2 * rng.standard_normal(N)
        reading = SWING * np.sin((np.arange(N) - late) / 15.0) + rng.standard_normal(N)
        assert all(c.evidence < ALARM for c in found(reading)), f"seed {seed}"
