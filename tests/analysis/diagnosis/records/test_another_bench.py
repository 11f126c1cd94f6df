"""A record of another bench than the model's is refused before any fit; a bench of the same kind never is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.records.checks import check_same_bench
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.records.loading import Loaded, Source
from sim_backend.errors import DataError
from sim_backend.linear import ModalModel, discretise

RATE_HZ, ROWS = 1000.0, 4000


def recorded(linear: ModalModel, seed: int, *, gain: float = 1.0, noise: float = 0.01) -> Loaded:
    """What a bench with this linear model does in noise, with friction of a tenth of the drive."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((ROWS, 1))
    y = gain * simulate(discretise(linear, RATE_HZ), u - 0.1 * np.sign(u))
    y += noise * np.std(y) * rng.standard_normal(y.shape)
    record = Record("uid-1", u, y, (Window("steps", 0, ROWS),))
    return Loaded(Dataset(RATE_HZ, (record,)), (Source("mine.h5", "", "uid-1", ROWS),), ())


@pytest.mark.parametrize("seed", range(40))
def test_numbers_that_are_off_by_five_per_cent_are_another_day_and_no_other_bench(oscillator, seed: int) -> None:
    rng = np.random.default_rng(seed)
    linear = oscillator.linear()
    off = replace(
        linear, omega_rad_s=linear.omega_rad_s * (1.0 + rng.uniform(-0.05, 0.05)), b=linear.b * rng.uniform(0.95, 1.05)
    )
    check_same_bench(recorded(off, seed, noise=float(rng.choice([0.0, 0.01, 0.3, 3.0]))), oscillator)


@pytest.mark.parametrize(("gain", "times"), [(57.3, "5[0-9]"), (1e-3, "0.0009")])
def test_a_wrong_unit_is_refused_with_file_output_and_factor(oscillator, gain: float, times: str) -> None:
    with pytest.raises(DataError, match=rf"mine\.h5: output 'x' moves {times}[0-9.]* times as much as the model says"):
        check_same_bench(recorded(oscillator.linear(), 0, gain=gain), oscillator)


def test_a_bench_of_other_modes_is_refused(oscillator) -> None:
    linear = oscillator.linear()
    other = replace(
        linear, omega_rad_s=linear.omega_rad_s * 6.0, sigma_1_s=linear.omega_rad_s * 3.0, b=linear.b * 1000.0
    )
    with pytest.raises(DataError, match="record of another bench"):
        check_same_bench(recorded(other, 0), oscillator)


def test_what_does_not_follow_the_drive_is_not_judged_here(oscillator) -> None:
    """A disturbance a hundred times as large as the motion: its size says nothing of the model."""
    check_same_bench(recorded(oscillator.linear(), 3, noise=100.0), oscillator)


@pytest.mark.parametrize("seed", range(10))
def test_a_loop_that_answers_the_noise_is_its_own_bench(oscillator, seed: int) -> None:
    """Far above its motion the input answers the noise alone, and so agrees with what is read, not by the plant."""
    rng = np.random.default_rng(seed)
    model = discretise(oscillator.linear(), RATE_HZ)
    (a,), (b,), c = model.a, model.b, model.c[0, 0]
    linear = oscillator.linear()
    omega, mobility = float(linear.omega_rad_s[0]), float(linear.b[0, 0] * linear.c[0, 0])
    stiffness, drag = 0.5 * omega**2 / mobility, 0.5 * omega / mobility
    reference, state, before = np.repeat(rng.standard_normal(ROWS // 400), 400), np.zeros(2), 0.0
    u, y = np.zeros((ROWS, 1)), np.zeros((ROWS, 1))
    for k in range(ROWS):
        y[k] = c @ state + 0.02 * rng.standard_normal()
        error = reference[k] - y[k, 0]
        u[k] = stiffness * error + drag * (error - before) * RATE_HZ
        before = error
        state = a @ state + b @ u[k]
    record = Record("uid-1", u, y, (Window("steps", 0, ROWS),))
    loaded = Loaded(Dataset(RATE_HZ, (record,)), (Source("mine.h5", "", "uid-1", ROWS),), ())
    check_same_bench(loaded, oscillator)
