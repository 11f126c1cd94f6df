"""A long record of a spring that stiffens: as many modes as there are, in seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.identification.identify import MANY_ROWS, identify_runs
from campaigns.log import read_run
from sim_backend.model import number
from tests.end_to_end.unknown_bench import imported, write_data, write_map

RATE_HZ, RESONANCE_HZ, CUBIC = 600.0, 70.0, 0.5


def _play(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return drive and reading (n,) of one mode, 4 % damped, by the leapfrog rule, ten steps to a sample."""
    rng, omega, finer = np.random.default_rng(12), 2.0 * np.pi * RESONANCE_HZ, 10
    drive = 0.3 * rng.standard_normal(n)
    y, x, v, h = np.zeros(n), 0.0, 0.0, 1.0 / RATE_HZ / finer
    for k, force in enumerate(drive.tolist()):
        y[k] = x
        for _ in range(finer):
            v += h * (omega**2 * (force - x - CUBIC * x**3) - 0.08 * omega * v)
            x += h * v
    return drive, y + 1e-4 * rng.standard_normal(n)


def test_what_is_not_linear_makes_no_modes_of_a_long_record(tmp_path: Path) -> None:
    n = MANY_ROWS + 10_000
    drive, reading = _play(n)
    write_data(tmp_path, drive, reading)
    write_map(tmp_path, RATE_HZ, [("train", n)])
    imported(tmp_path)
    found = identify_runs([read_run(tmp_path / "run.h5")])
    assert found.method == "free, averaged spectra"
    assert len(found.model.modes) == 1
    # of a motion of normal distribution the cubic term is 3 k rms² times its best linear likeness
    stiffer = np.sqrt(1.0 + 3.0 * CUBIC * np.var(reading))
    assert abs(number(found.model.modes[0].frequency_hz) / (stiffer * RESONANCE_HZ) - 1.0) < 0.03
