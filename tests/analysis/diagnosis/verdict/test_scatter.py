"""What differs between periods is noise only where it is the same whatever is played."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.verdict.scatter import scatter_follows_play

PERIOD, COUNT, RATE_HZ = 1000, 5, 1000.0
SIZES = 1.0, 3.0, 10.0


def records(scatters: list[np.ndarray]) -> tuple[Dataset, list[np.ndarray]]:
    """One record of each size, a wave that repeats, with what is scattered over it; and that as the residual."""
    wave = np.tile(np.sin(2.0 * np.pi * np.arange(PERIOD) / 50.0), COUNT)
    made = []
    for k, (size, scatter) in enumerate(zip(SIZES, scatters, strict=True)):
        y = (size * wave + scatter)[:, None]
        made.append(Record(f"run-{k}", size * wave[:, None], y, (Window("level", 0, y.shape[0], period=PERIOD),)))
    return Dataset(RATE_HZ, tuple(made)), [s[:, None] for s in scatters]


def coloured(rng: np.random.Generator, slope: float) -> np.ndarray:
    """Noise whose power falls with frequency to the power of `slope`."""
    n = PERIOD * COUNT
    lines = np.fft.rfft(rng.standard_normal(n))
    return np.fft.irfft(lines / np.maximum(np.arange(lines.size), 1.0) ** (slope / 2.0), n)


@pytest.mark.parametrize("slope", [0.0, 1.0, 2.0])
def test_noise_of_any_colour_does_not_follow_what_is_played(slope: float) -> None:
    rng = np.random.default_rng(int(slope))
    found = [scatter_follows_play(*records([coloured(rng, slope) for _ in SIZES])) for _ in range(300)]
    assert not any(found)


@pytest.mark.parametrize("share", [0.3, 0.01])
def test_a_stiffness_that_breathes_is_no_noise(share: float) -> None:
    """Sidebands of the drive that never repeat, in a sensor's noise of the same size in the smallest record."""
    rng = np.random.default_rng(3)
    t = np.arange(PERIOD * COUNT)
    breathing = np.sin(2.0 * np.pi * t / 50.0) * np.cos(2.0 * np.pi * t * 0.00731)
    noise = 0.5 * share * rng.standard_normal((len(SIZES), t.size))
    told = scatter_follows_play(*records([share * size * breathing + e for size, e in zip(SIZES, noise, strict=True)]))
    assert "grows with the motion" in told


def test_noise_that_is_louder_in_one_record_is_not_called_the_motion() -> None:
    """The quietest motion in the loudest hour: it does not rise with what is played."""
    rng = np.random.default_rng(4)
    loud = [scale * rng.standard_normal(PERIOD * COUNT) for scale in (5.0, 1.0, 1.0)]
    assert scatter_follows_play(*records(loud)) == ""
