"""What of a residual repeats over the position, in fine steps over a long way and in slow noise."""

from __future__ import annotations

import numpy as np
import pytest

from sim_backend.effects.over_position import OverPosition
from sim_backend.effects.view import RecordView

N = 20_000


def positions(rng: np.random.Generator) -> np.ndarray:
    """Return positions (n,) that lie about a centimetre from their zero and move by as much."""
    return 1e-2 + 5e-3 * np.sin(2.0 * np.pi * np.arange(N) / 977.0) + 1e-3 * np.cumsum(rng.standard_normal(N)) / N**0.5


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_step_of_a_rounding_is_found_by_its_phase_far_from_its_zero(seed: int) -> None:
    """Of 2,500 steps the last is a tenth of a step off at most; the distance between two peaks tells half a step."""
    rng = np.random.default_rng(seed)
    x, step = positions(rng), 4e-6 * rng.uniform(0.9, 1.1)
    error = step * np.round(x / step) - x + step * rng.standard_normal(N)
    over = OverPosition.of(x, error)
    assert over is not None
    (found,) = over.steps(1)
    assert abs(1.0 / found - 1.0 / step) * np.max(x) < 0.1
    (period,) = over.periods(1)
    assert abs(1.0 / period - 1.0 / step) * np.ptp(x) < 0.5


def test_a_wave_over_the_position_is_found_where_slow_noise_hides_it_from_the_measured_motion() -> None:
    """The residual's own slow part, taken for motion, moves the positions by a distance and more."""
    rng = np.random.default_rng(3)
    x, period = positions(rng), 5e-6
    slow = np.cumsum(rng.standard_normal(N))
    slow *= 5e-6 / slow.std()
    residual = 2e-6 * np.sin(2.0 * np.pi * x / period) + 2e-6 * rng.standard_normal(N) + slow
    still = np.zeros(N)

    def found(sensed: np.ndarray | None) -> list[float]:
        seen = RecordView(1e3, still, x + slow, still, residual, None, 0.0, sensed=sensed)
        return [abs(1.0 / p - 1.0 / period) * float(np.ptp(x)) for p in seen.residual_periods(4)]

    assert min(found(None)) > 0.5 and min(found(x)) < 0.5


def test_nothing_is_over_a_position_that_rests() -> None:
    assert OverPosition.of(np.ones(N), np.zeros(N)) is None
