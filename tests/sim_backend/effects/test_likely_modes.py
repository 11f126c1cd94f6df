"""A weak mode is found by what it makes of the input, where no line of it stands out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from sim_backend.effects.view import RecordView

RATE_HZ, ROWS = 10_000.0, 120_000


def heard(frequency_hz: float, damping: float, strength: float) -> RecordView:
    """White noise through one mode (a two-pole filter) at `strength` of the noise's rms, in white noise."""
    rng = np.random.default_rng(3)
    u = rng.standard_normal(ROWS)
    pole = np.exp((-damping + 1j * np.sqrt(1.0 - damping**2)) * 2.0 * np.pi * frequency_hz / RATE_HZ)
    y = lfilter([0.0, 1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], u)
    y = strength * y / y.std() + rng.standard_normal(ROWS)
    return RecordView(RATE_HZ, u, y, y, y, None, 29.0)


@pytest.mark.parametrize(("frequency_hz", "damping"), [(261.0, 0.011), (1440.0, 0.02), (77.0, 0.05)])
def test_a_mode_under_the_noise_is_found(frequency_hz, damping):
    """At a twentieth of the noise all rows together are worth 0.05 √120000 = 17 standard deviations."""
    (found, ratio), *_ = heard(frequency_hz, damping, 0.05).likely_modes(4, (0.005, 0.015, 0.05))
    assert abs(found / frequency_hz - 1.0) < max(damping, ratio)


def test_a_still_input_speaks_for_no_mode():
    still = np.zeros(4096)
    assert RecordView(RATE_HZ, still, still, still, still + 1.0, None, 29.0).likely_modes(4, (0.01,)) == []
