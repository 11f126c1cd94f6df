"""Settling measured on responses whose settling is known in closed form."""

import numpy as np
import pytest

from analysis.measurements.settling import BAND_RAD, settling
from sim_backend.errors import DataError

RATE_HZ = 10_000.0
TIME = np.arange(4000) / RATE_HZ


def test_exponential_settles_when_its_envelope_enters_the_band():
    amplitude, decay = 1e-3, 30.0
    result = settling(5e-3 - amplitude * np.exp(-decay * TIME), RATE_HZ, final=5e-3)
    crossing = np.log(amplitude / BAND_RAD) / decay
    assert crossing - 1 / RATE_HZ <= result.time_s[0] <= crossing
    assert result.overshoot[0] == 0.0


def test_a_ring_settles_by_its_last_excursion_and_overshoots_by_its_first():
    amplitude, decay, omega = 50e-6, 20.0, 2 * np.pi * 500.0
    y = amplitude * np.exp(-decay * TIME) * np.cos(omega * TIME + np.pi)
    result = settling(1e-3 + y, RATE_HZ, final=1e-3)
    envelope = np.log(amplitude / BAND_RAD) / decay
    # the last excursion lies within half a period before the envelope's crossing
    assert envelope - np.pi / omega - 1 / RATE_HZ <= result.time_s[0] <= envelope
    # first maximum above the end half a period in; sampling at 20 points per period misses at most 1 - cos(pi/20)
    peak = amplitude * np.exp(-decay * np.pi / omega)
    assert peak * np.cos(np.pi / 20) <= result.overshoot[0] <= peak * (1 + 1e-9)


def test_moves_down_overshoot_downwards_and_moves_are_told_apart():
    up = np.concatenate([np.linspace(0, 1e-3, 50), [1.2e-3], np.full(100, 1e-3)])
    result = settling(np.stack([up, 1e-3 - up]), RATE_HZ, final=[1e-3, 0.0])
    assert np.allclose(result.overshoot, 2e-4)
    assert np.allclose(result.time_s, 50 / RATE_HZ)


def test_never_and_always_settled():
    assert settling(np.zeros(10), RATE_HZ).time_s[0] == 0.0
    drift = np.linspace(0, 1e-3, 100)
    assert np.isinf(settling(drift, RATE_HZ, final=0.0).time_s[0])


def test_without_an_end_the_last_tenth_gives_it():
    y = np.concatenate([np.zeros(10), np.full(190, 2e-3)])
    assert settling(y, RATE_HZ).final[0] == pytest.approx(2e-3, rel=1e-14)


@pytest.mark.parametrize(
    ("output", "rate", "band", "word"),
    [
        (np.array([1.0]), 1.0, 1.0, "two samples"),
        (np.array([1.0, np.nan]), 1.0, 1.0, "sample 1 of move 0"),
        (np.zeros(5), 0.0, 1.0, "rate"),
        (np.zeros(5), 1.0, 0.0, "band"),
    ],
)
def test_bad_records_are_refused(output, rate, band, word):
    with pytest.raises(DataError, match=word):
        settling(output, rate, band=band)
