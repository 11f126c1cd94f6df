"""A multisine has the lines of its band that there are, however wide the band is said to be."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.plans.multisine import orthogonal
from sim_backend.errors import ConfigError


def wave(start_hz: float, stop_hz: float) -> np.ndarray:
    return next(orthogonal(1000, 1000.0, start_hz, stop_hz, 1, np.random.default_rng(1)))[:, 0]


@pytest.mark.parametrize("stop_hz", [499.0, 500.0, 1e7, 1e308, np.inf])
def test_a_band_ends_below_half_the_rate(stop_hz: float) -> None:
    np.testing.assert_array_equal(wave(1.0, stop_hz), wave(1.0, 499.0))


@pytest.mark.parametrize("start_hz", [500.0, 1e308, np.inf])
def test_a_band_without_lines_is_refused(start_hz: float) -> None:
    with pytest.raises(ConfigError, match="no line of 1 Hz lies between"):
        wave(start_hz, np.inf)
