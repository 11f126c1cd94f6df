"""Lost samples: counted where a repeat is impossible by chance, and told from a sensor that is stuck or slow."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.variance.repeats import lost_samples, repeats_of
from tests.analysis.diagnosis.residuals import setting_of

N = 20_000


def _motion(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    true = 50.0 * np.sin(np.arange(N) / 30.0)
    return true, true + rng.standard_normal(N)


def _with_losses(values: np.ndarray, lost: np.ndarray) -> np.ndarray:
    out = values.copy()
    for k in np.flatnonzero(lost):
        if k:
            out[k] = out[k - 1]
    return out


@pytest.mark.parametrize("share", [2e-4, 0.01, 0.3])
def test_the_share_of_lost_samples_is_found(share: float) -> None:
    """Within three standard deviations of counting, of ten records."""
    off = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        true, noisy = _motion(rng)
        reading = _with_losses(noisy, rng.random(N) < share)
        setting, fit = setting_of(np.zeros(N), reading, reading - true, 1.0)
        (cause,) = lost_samples(setting, fit)
        assert cause.p_value < 1e-9
        off.append((cause.effect.values()[0] - share) / cause.std["fraction"])
    # with four losses expected, what is counted may be off by more than its own root says; ten of them average out
    assert abs(np.mean(off)) < 3.0 / np.sqrt(10.0) + 0.5 / np.sqrt(share * N)


def test_nothing_is_lost_in_sixty_records_without_losses() -> None:
    """Continuous readings, and readings on a lattice of half to thirty times the noise."""
    for seed in range(60):
        rng = np.random.default_rng(100 + seed)
        true, noisy = _motion(rng)
        step = (0.0, 0.5, 2.0, 30.0)[seed % 4]
        reading = step * np.rint(noisy / step) if step else noisy
        setting, fit = setting_of(np.zeros(N), reading, reading - true, 1.0)
        found = lost_samples(setting, fit)
        assert all(c.p_value > 1e-3 for c in found), f"seed {seed}"


def test_losses_are_found_on_a_lattice_where_the_motion_is_fast() -> None:
    """Only pairs that cannot be equal by chance count, so the share stays right."""
    rng = np.random.default_rng(7)
    true, noisy = _motion(rng)
    lost = rng.random(N) < 0.02
    reading = _with_losses(0.1 * np.rint(300.0 * true / 0.1) + 0.1 * np.rint(noisy / 0.1), lost)
    seen = repeats_of([reading], [301.0 * true])
    assert 0.9 * N < seen.pairs < N
    assert seen.fraction == pytest.approx(0.02, abs=4.0 * np.sqrt(0.02 / N))


def test_a_stuck_or_slow_sensor_is_another_matter() -> None:
    """Repeats that stand together, or every other sample, are no random losses."""
    rng = np.random.default_rng(8)
    true, noisy = _motion(rng)
    stuck = np.zeros(N, dtype=bool)
    stuck[5000:5400] = True
    slow = np.arange(N) % 2 == 1
    for lost in (stuck, slow):
        reading = _with_losses(noisy, lost)
        assert not repeats_of([reading], [true]).random
        assert lost_samples(*setting_of(np.zeros(N), reading, reading - true, 1.0)) == []


def test_equal_readings_of_six_significant_digits_are_no_losses() -> None:
    """Text has no lattice: its last digit counts a thousand times as much at the peaks as near zero."""
    for seed in range(20):
        rng = np.random.default_rng(300 + seed)
        true, noisy = _motion(rng)
        reading = np.array([float(f"{value:.3e}") for value in noisy])
        assert np.sum(np.diff(reading) == 0.0) > 0
        setting, fit = setting_of(np.zeros(N), reading, reading - true, 1.0)
        assert all(c.p_value > 1e-3 for c in lost_samples(setting, fit)), f"seed {seed}"
