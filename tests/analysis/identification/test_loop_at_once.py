"""A loop that answers a reading within its sample is told from an open one, whatever is played."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.identification.loop_at_once import answers_at_once
from analysis.identification.timefit import fit_records
from tests.end_to_end.linear_bench import held, loop_at_once, oscillator

Array = NDArray[np.float64]

RATE_HZ, ROWS = 500.0, 4000


def _open(drive: Array, noise_rms: float, cubic: float = 0.0) -> tuple[Array, Array]:
    """Return drive and reading (n, 1) of a mode at 20 Hz whose spring may stiffen, by small steps of the linear one."""
    rng, omega, finer = np.random.default_rng(4), 2.0 * np.pi * 20.0, 8
    over, into = held(oscillator(20.0, 0.05), np.array([[0.0], [omega**2]]), RATE_HZ * finer)
    x, y = np.zeros(2), np.empty((drive.size, 1))
    for k, force in enumerate(drive):
        y[k] = x[0] + noise_rms * rng.standard_normal()
        for _ in range(finer):
            x = over @ x + into[:, 0] * (force - cubic * x[0] ** 3)
    return drive[:, None], y


def _drive(waveform: str) -> Array:
    rng = np.random.default_rng(9)
    if waveform == "noise":
        return rng.standard_normal(ROWS)
    if waveform == "steps":
        return np.repeat(rng.uniform(-1.0, 1.0, ROWS // 50), 50)
    spectrum = np.zeros(501, complex)
    spectrum[1:60] = np.exp(2j * np.pi * rng.random(59))
    wave = np.fft.irfft(spectrum, 1000)
    return np.tile(wave / wave.std(), ROWS // 1000)


@pytest.mark.parametrize("waveform", ["noise", "steps", "multisine"])
@pytest.mark.parametrize("cubic", [0.0, 0.1])
def test_an_open_bench_does_not_answer(waveform: str, cubic: float) -> None:
    """Not even where the spring is none that the model has, so that most of what is left is no noise."""
    u, y = _open(_drive(waveform), 1e-3, cubic)
    assert not answers_at_once(fit_records([u], [y], RATE_HZ, 1), [u], [y])


@pytest.mark.parametrize("cubic", [0.0, 0.1])
def test_smooth_drives_that_no_filter_makes_white_do_not_answer(cubic: float) -> None:
    """Smooth steps, then noise of a limited band, both far above the noise of the reading."""
    move = (1.0 - np.cos(np.pi * np.arange(25) / 25)) / 2.0
    levels = np.random.default_rng(9).uniform(-1.0, 1.0, ROWS // 50)
    steps = [a + (b - a) * np.r_[move, np.ones(25)] for a, b in zip(np.r_[0.0, levels[:-1]], levels, strict=True)]
    spectrum = np.fft.rfft(np.random.default_rng(8).standard_normal(ROWS))
    spectrum[ROWS // 20 :] = 0.0
    band = np.fft.irfft(spectrum, ROWS)
    u, y = zip(*(_open(drive, 1e-6, cubic) for drive in (np.concatenate(steps), band / band.std())), strict=True)
    assert not answers_at_once(fit_records(u, y, RATE_HZ, 1, rigid_bodies=None), u, y)


def test_a_loop_answers() -> None:
    record = loop_at_once()
    fit = fit_records([record.drives], [record.readings], record.rate_hz, 1, rigid_bodies=None)
    assert answers_at_once(fit, [record.drives], [record.readings])


def test_an_input_that_never_moves_does_not_answer() -> None:
    u, y = _open(_drive("noise"), 1e-3)
    both = np.hstack([u, np.zeros_like(u)])
    fit = fit_records([u], [y], RATE_HZ, 1)
    assert not answers_at_once(fit, [both], [y])
