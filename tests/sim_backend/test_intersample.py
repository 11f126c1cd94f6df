"""The steps that stand for a smooth input give, held, what the smooth input gives."""

from __future__ import annotations

import numpy as np
import pytest

from sim_backend.intersample import hold_response, steps_for

RATE_HZ = 1000.0


def held_finely(steps: np.ndarray, times: int) -> np.ndarray:
    return np.repeat(steps, times, axis=0)


@pytest.mark.parametrize("period", [500, 0])
def test_held_steps_have_the_smooth_signals_spectrum_in_band(period: int) -> None:
    """Held on a grid 64 times finer, the steps' line at each frequency is the sine's own amplitude and phase."""
    t = np.arange(2000) / RATE_HZ
    lines = {20.0: 1.0, 130.0: -0.7, 310.0: 0.4}
    u = sum((a * np.sin(2.0 * np.pi * f * t + 0.3) for f, a in lines.items()), np.zeros(t.size))[:, None]
    fine = held_finely(steps_for(u, period=period), 64)[:, 0]
    fine_t = (np.arange(fine.size) + 0.5) / (64.0 * RATE_HZ)
    # without a period the ends are guesses, which reach a few samples in; whole periods of all lines lie between
    middle = slice(500 * 64, 1500 * 64)
    for f, a in lines.items():
        found = 2.0 * np.mean(fine[middle] * np.exp(-2j * np.pi * f * fine_t[middle]))
        expected = a * np.exp(1j * (0.3 - np.pi / 2.0))
        # the midpoint rule on the fine grid weakens a line by (π f / 64 rate)² / 6 < 4e-5; ends without a period: 1e-3
        assert abs(found - expected) < (1e-4 if period else 2e-3) * abs(a)


def test_a_plain_hold_would_be_half_a_sample_late() -> None:
    response = hold_response(np.array([0.1]))[0]
    assert np.angle(response) == pytest.approx(-np.pi * 0.1)
    assert abs(response) == pytest.approx(np.sin(0.1 * np.pi) / (0.1 * np.pi))


def test_a_constant_stays_what_it_is() -> None:
    assert steps_for(np.full((64, 2), 3.0)) == pytest.approx(3.0, abs=1e-12)
    assert steps_for(np.full((64, 2), 3.0), period=64) == pytest.approx(3.0, abs=1e-12)
