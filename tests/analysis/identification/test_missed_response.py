"""A model that misses what the measured response shows says so, whatever it was fitted to; a good one does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from analysis.identification.from_table import identify_table
from analysis.identification.identified import Identification
from analysis.identification.identify import MANY_ROWS, identify_runs
from analysis.identification.missed_response import worst_miss
from campaigns.log import read_run
from tests.analysis.identification.test_from_table import F, response, written
from tests.analysis.identification.two_mode_bench import FREQUENCIES_HZ, RATE_HZ, play, write

PERIOD, PERIODS = 2000, 6


def misses(found: Identification) -> list[str]:
    return [remark for remark in found.remarks if "the model misses" in remark]


def frequency_of(remark: str) -> float:
    return float(remark.partition(" at ")[2].partition(" Hz")[0])


def periodic(path: Path) -> Path:
    """Steady periods of the linear bench; its transient has died out to e^-20 before they begin."""
    u, _ = play(0.0, 4, PERIOD)
    u = np.tile(u, PERIODS + 5)
    omega, gain = 2.0 * np.pi * FREQUENCIES_HZ, np.array([1.0, 20.0])
    y = np.zeros(u.size)
    for w, g, zeta in zip(omega, gain, (0.03, 0.01), strict=True):
        system = (
            np.array([[0.0, 1.0], [-(w**2), -2.0 * zeta * w]]),
            np.array([[0.0], [g]]),
            np.eye(1, 2),
            np.zeros((1, 1)),
        )
        y += dlsim(cont2discrete(system, 1.0 / RATE_HZ), u)[1][:, 0]
    y = y[5 * PERIOD :] + 1e-3 * y.std() * np.random.default_rng(4).standard_normal(PERIODS * PERIOD)
    parts = [("fit", 0, u.size - 5 * PERIOD)]
    return write(path, u[5 * PERIOD :], y, parts, period_samples=PERIOD, transient_periods=1)


@pytest.mark.parametrize("modes", [1, 2])
def test_periods(tmp_path, modes):
    with read_run(periodic(tmp_path / "run.h5")) as run:
        found = identify_runs([run], modes=modes)
    assert found.method.startswith("periodic")
    told = misses(found)
    assert len(told) == (modes == 1)
    if told:
        assert abs(frequency_of(told[0]) - FREQUENCIES_HZ[1]) < 20.0 and "u → y" in told[0]


@pytest.mark.parametrize("modes", [1, 2])
def test_averaged_spectra(tmp_path, modes):
    n = MANY_ROWS + 10_000
    u, y = play(0.0, 6, n)
    with read_run(write(tmp_path / "run.h5", u, y, [("fit", 0, n)])) as run:
        found = identify_runs([run], modes=(modes, modes + 1) if modes == 2 else (1, 1))
    assert found.method == "free, averaged spectra"
    assert len(misses(found)) == (modes == 1)


@pytest.mark.parametrize("noise", [1e-4, 1e-3, 1e-2])
def test_tables(tmp_path, noise):
    rng = np.random.default_rng(1)
    h = response(F) * (1.0 + noise * (rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size)))
    path = written(tmp_path / "h.csv", ["f (Hz)", "Re", "Im"], [F, h.real, h.imag])
    assert misses(identify_table(path, modes=2)) == []
    (told,) = misses(identify_table(path, modes=1))
    assert "input → output" in told


def test_what_the_noise_hides_is_no_miss():
    """An antiresonance far below additive noise: the model differs there by more than the response, and rightly."""
    f = np.arange(1.0, 101.0)
    model = np.asarray((f - 50.5) / 50.0, dtype=np.complex128)
    rng = np.random.default_rng(8)
    noise = 0.05 * (rng.standard_normal(f.size) + 1j * rng.standard_normal(f.size))
    variance = np.full(f.size, 2.0 * 0.05**2)
    off = np.asarray(model + noise, dtype=np.complex128)
    assert worst_miss(f, off, model, variance) is None
    off[20] += 1.0
    found = worst_miss(f, off, model, variance)
    assert found is not None and found.frequency_hz == f[20]
