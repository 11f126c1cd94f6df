"""Slow softening detunes a mode by the level of its motion: a sine stays a sine, and nothing is damped by it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sim_backend.assembly import places_of, transducers_of
from sim_backend.effects import make_effect
from sim_backend.replay import replay
from tests.analysis.diagnosis.residuals import DECAY_1_S, MODEL, RATE_HZ, RESONANCE_HZ

Array = NDArray[np.float64]

LEVEL, SOFTENING = 0.4, 0.05
LINEAR = MODEL.linear()


def _steady(frequency_hz: float, drive: float, effect: str, **parameters: float) -> Array:
    """Return the last forty periods of the answer to a sine, (n,)."""
    per_period = RATE_HZ / frequency_hz
    n = int(round(per_period * 240))
    u = drive * np.sin(2.0 * np.pi * np.arange(n) / per_period)[:, None]
    acting = [make_effect(effect, "mode 1", parameters)]
    played = replay(LINEAR, acting, places_of(MODEL), transducers_of(MODEL), u, RATE_HZ, substeps=16)
    return played.reading[-int(round(per_period * 40)) :, 0]


def _line(answer: Array, periods: int) -> float:
    spectrum = np.abs(np.fft.rfft(answer)) / answer.size * 2.0
    return float(spectrum[periods])


def test_a_mode_is_softer_by_the_level_of_its_motion() -> None:
    """At rms r it has lost softening · r / level of its stiffness; its answer is that of the softer mode."""
    f_hz = 0.9 * RESONANCE_HZ
    for drive in (0.05, 0.1):
        answer = _steady(f_hz, drive, "slow-softening", softening=SOFTENING, level=LEVEL, memory=0.2)
        lost = SOFTENING * np.std(answer) / LEVEL
        omega, sigma = 2.0 * np.pi * RESONANCE_HZ, DECAY_1_S
        w = 2.0 * np.pi * f_hz
        expected = drive * abs(omega**2 / (omega**2 * (1.0 - lost) - w**2 + 2j * sigma * w))
        assert lost > 0.005
        assert _line(answer, 40) == pytest.approx(expected, rel=3e-3)


def test_a_sine_stays_a_sine() -> None:
    """What detunes as much and follows the deflection itself makes a third harmonic of a quarter of its force."""
    f_hz = RESONANCE_HZ / 4.0
    slow = _steady(f_hz, 0.3, "slow-softening", softening=SOFTENING, level=LEVEL, memory=0.5)
    # the stiffness of a cubic spring falls by 3/2 r² of its coefficient on the average over a sine
    prompt = _steady(f_hz, 0.3, "cubic-stiffness", stiffness=-SOFTENING / LEVEL / (1.5 * float(np.std(slow))))
    assert _line(prompt, 40) == pytest.approx(_line(slow, 40), rel=2e-3)
    assert _line(slow, 120) < 0.05 * _line(prompt, 120)


def test_what_was_before_the_record_is_taken_to_be_like_it() -> None:
    """A sine that goes on from the start is softer from its first periods on, not only after the memory."""
    t = np.arange(4000) / RATE_HZ
    u = 0.1 * np.sin(2.0 * np.pi * 0.9 * RESONANCE_HZ * t)[:, None]
    acting = [
        [make_effect("slow-softening", "mode 1", {"softening": 0.05, "level": 0.4, "memory": m})] for m in (0.1, 50.0)
    ]
    short, long = (
        replay(LINEAR, effects, places_of(MODEL), transducers_of(MODEL), u, RATE_HZ, substeps=8).reading[2000:, 0]
        for effects in acting
    )
    assert np.std(short - long) < 0.01 * np.std(short)
