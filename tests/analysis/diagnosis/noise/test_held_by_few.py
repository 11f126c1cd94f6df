"""Slow noise beside what a few of the slowest rows hold, where nothing repeats that would tell the two apart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from tests.analysis.diagnosis.two_modes import RATE_HZ

N = 6000


def _white(rng: np.random.Generator) -> np.ndarray:
    return rng.standard_normal(N)


def _falling(rng: np.random.Generator) -> np.ndarray:
    """Power that falls as 1/f between 0.0005 and 0.05 cycles per sample: three stages of one pole each."""
    x = rng.standard_normal(N + 4000)
    for pole, zero in ((0.9969, 0.99), (0.969, 0.9), (0.73, 0.3)):
        x = lfilter([1.0, -zero], [1.0, -pole], x)
    return x[4000:]


def _wandering(rng: np.random.Generator) -> np.ndarray:
    """A random walk that is held, of a tenth of the white noise a sample."""
    return lfilter([0.1], [1.0, -0.999], rng.standard_normal(N + 4000))[4000:] + rng.standard_normal(N)


def _humped(rng: np.random.Generator) -> np.ndarray:
    return lfilter([1.0], [1.0, -1.9, 0.95], rng.standard_normal(N + 400))[400:]


NOISES = {"white": _white, "1/f": _falling, "random walk": _wandering, "hump": _humped}


def _whitener(residual: np.ndarray) -> Whitener:
    record = Record("r", np.zeros((N, 1)), residual[:, None], (Window("p", 0, N, False, 0),))
    return whitener_from(Dataset(RATE_HZ, (record,)), [residual[:, None]])


def _slow_power(whitener: Whitener, noise: np.ndarray) -> float:
    """Return the mean square of the rows of `noise` below 0.012 cycles per sample, the lowest dozen apart."""
    rows = whitener.rows(noise[:, None], np.ones(N, dtype=bool), 0)[:, 0]
    return float(np.mean(rows[12 : int(0.012 * 2 * N)] ** 2))


def _drift(rng: np.random.Generator) -> np.ndarray:
    return rng.choice([-1.0, 1.0]) * np.linspace(0.0, 1.0, N) ** rng.uniform(0.7, 2.0)


@pytest.mark.parametrize("kind", ["white", "hump"])
def test_noise_beside_a_drift_keeps_its_level(kind: str) -> None:
    rng = np.random.default_rng(11)
    powers = []
    for _ in range(20):
        noise = NOISES[kind](rng)
        noise = noise / noise.std()
        powers.append(_slow_power(_whitener(noise + rng.uniform(2.0, 10.0) * _drift(rng)), noise))
    # a filter that has learnt the drift leaves a tenth of them and less
    assert 0.6 < np.mean(powers) < 1.2 and np.min(powers) > 0.3


@pytest.mark.parametrize("kind", NOISES)
def test_noise_alone_is_no_louder_than_its_level(kind: str) -> None:
    rng = np.random.default_rng(12)
    powers = []
    for _ in range(40):
        noise = NOISES[kind](rng)
        powers.append(_slow_power(_whitener(noise), noise))
    # 130 rows: each mean square is known to 12 %
    assert np.mean(powers) < 1.1 and np.max(powers) < 1.6
