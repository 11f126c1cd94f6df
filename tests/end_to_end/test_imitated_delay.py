"""What a linear fit has made a delay of: a hysteresis in a record where nothing repeats, and the delay taken back.

The bench is the Bouc–Wen oscillator of `test_bouc_wen` with other phases and levels, by Euler's semi-implicit
rule. Not every such record gets a delay: of the seeds from 54 on, this is the first whose record has one; the test
asks for it before all else.
"""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from tests.end_to_end.test_bouc_wen import (
    ALPHA_N_M,
    BETA_1_M,
    DAMPING_N_S_M,
    GAMMA,
    MASS_KG,
    NOISE_M,
    RATE_HZ,
    SPRING_N_M,
    STIFFENING,
)
from tests.end_to_end.unknown_bench import diagnosis, identified, imported, write_data, write_map

ROWS, FINER = 8192, 20
LEVELS_N = {"25 N": 25.0, "50 N": 50.0, "held-out 35 N": 35.0}

pytestmark = pytest.mark.slow


@njit
def moved(u, y):
    """Fill `y` (n,) with the position under held forces `u` (n,)."""
    h = 1.0 / RATE_HZ / FINER
    x, v, z = 0.0, 0.0, 0.0
    for k in range(u.size):
        y[k] = x
        for _ in range(FINER):
            slope = ALPHA_N_M * v - BETA_1_M * (GAMMA * abs(v) * z + STIFFENING * v * abs(z))
            v += h * (u[k] - DAMPING_N_S_M * v - SPRING_N_M * x - z) / MASS_KG
            x += h * v
            z += h * slope


def write_log(folder: Path) -> None:
    rng = np.random.default_rng(54)
    lines = np.arange(int(5 * ROWS / RATE_HZ), int(150 * ROWS / RATE_HZ))
    force = []
    for level in LEVELS_N.values():
        spectrum = np.zeros(ROWS // 2 + 1, complex)
        spectrum[lines] = np.exp(2j * np.pi * rng.random(lines.size))
        wave = np.fft.irfft(spectrum)
        force.append(wave * level / wave.std())
    u = np.concatenate(force)
    y = np.empty(u.size)
    moved(u, y)
    write_data(folder, u, y + NOISE_M * rng.standard_normal(u.size))
    write_map(folder, RATE_HZ, [(label, ROWS) for label in LEVELS_N], None, "N")


def delay_s(path: Path) -> float:
    (delay,) = tomllib.loads(path.read_text()).get("delay_s", {"": {"value": 0.0}}).values()
    return float(delay["value"])


def test_a_hysteresis_is_named_beside_the_delay_that_imitated_it(tmp_path: Path) -> None:
    write_log(tmp_path)
    imported(tmp_path)
    identified(tmp_path)
    imitated = delay_s(tmp_path / "nominal.toml")
    assert imitated > 0.5 / RATE_HZ  # or this record is no example
    found = diagnosis(tmp_path)
    assert found["verdict"] == "named", found["sentence"]
    assert [(c["effect"], c["where"]) for c in found["causes"]] == [("hysteresis", "x")]
    assert found["gain"]["rms_after"] < 0.2 * found["gain"]["rms_before"]
    assert delay_s(tmp_path / "out" / "extended.toml") < 0.1 * imitated
    (effect,) = [
        e
        for e in tomllib.loads((tmp_path / "out" / "extended.toml").read_text())["effects"]
        if e["effect"] == "bouc-wen"
    ]
    true = {"stiffness": ALPHA_N_M, "reach": 1.0 / (BETA_1_M * GAMMA), "gamma_over_beta": STIFFENING / GAMMA}
    for name, number in true.items():
        assert effect["parameters"][name]["value"] == pytest.approx(number, rel=0.05)
