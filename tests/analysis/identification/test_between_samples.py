"""What an input does between its samples, and how late it acts, is decided by the model that will be simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.identification.identify import identify_runs
from analysis.linear.simulate import simulate_linear
from campaigns.log import Channel, LogWriter, read_run
from sim_backend.intersample import hold_response
from sim_backend.linear import ModalModel, discretise

RATE_HZ, PERIOD = 400.0, 800
FINE = 20
"""Steps of the simulation in one sample of the log: what lies between samples is made there, not assumed."""


def plant(rate_hz: float, frequency_hz: float, delay_s: float) -> ModalModel:
    omega = 2.0 * np.pi * frequency_hz
    one = np.ones((1, 1))
    zero = np.zeros((1, 1))
    return ModalModel(
        omega_rad_s=np.array([omega]),
        sigma_1_s=np.array([0.03 * omega]),
        b=omega**2 * one,
        b_direct=zero,
        c=one,
        c_rate=zero,
        d=zero,
        delay_s=np.array([delay_s]),
    )


def record(path: Path, *, smooth: bool, delay_s: float, frequency_hz: float = 17.0) -> Path:
    """Six periods of a multisine to 80 Hz, after four that nobody recorded, through one mode."""
    rng = np.random.default_rng(7)
    lines = np.arange(1, 161)
    phase = rng.uniform(0.0, 2.0 * np.pi, lines.size)
    rows = 10 * PERIOD
    at = np.arange(rows * FINE) / (PERIOD * FINE)
    period = np.cos(2.0 * np.pi * np.outer(at[: PERIOD * FINE], lines) + phase).sum(axis=1) * 1e-3
    fine = np.tile(period, 10)
    played = fine if smooth else np.repeat(fine[::FINE], FINE)
    y = simulate_linear(discretise(plant(0, frequency_hz, delay_s), RATE_HZ * FINE), played[:, None])[::FINE, 0]
    kept = slice(4 * PERIOD, None)
    u, y = fine[::FINE][kept], y[kept] + 2e-6 * rng.standard_normal(6 * PERIOD)
    channels = [Channel("u", "N m", "input", "a", RATE_HZ), Channel("y", "rad", "output", "a", RATE_HZ)]
    with (
        LogWriter.create(path, channels, test="multisine", bench={"kind": "imported", "name": "n"}) as log,
        log.segment("record", {"period_samples": PERIOD}),
    ):
        log.append({"u": u, "y": y})
    return path


DELAYS = pytest.mark.parametrize("delay_samples", [0.0, 0.48, 2.0, 3.3])


def identified(path: Path):
    with read_run(path) as run:
        return identify_runs([run], modes=1)


@DELAYS
def test_a_held_input_is_known_as_such_with_any_delay(tmp_path, delay_samples):
    found = identified(record(tmp_path / "a.h5", smooth=False, delay_s=delay_samples / RATE_HZ))
    (mode,) = found.modes
    assert found.model.intersample == "held"
    assert abs(mode["frequency_hz"] - 17.0) < 4.0 * mode["frequency_std_hz"]
    assert abs(mode["decay_rate_1_s"] - 0.03 * 2 * np.pi * 17.0) < 4.0 * mode["decay_rate_std_1_s"]
    assert found.chi2_per_dof is not None and found.chi2_per_dof < 1.5


@DELAYS
def test_a_smooth_input_is_known_as_such_with_any_delay(tmp_path, delay_samples):
    """Steps stand for it up to the images above half the rate: a few times the noise, which is low here."""
    path = record(tmp_path / "a.h5", smooth=True, delay_s=delay_samples / RATE_HZ)
    found = identified(path)
    (mode,) = found.modes
    assert found.model.intersample == "band-limited"
    assert mode["frequency_hz"] == pytest.approx(17.0, abs=1e-3)
    assert mode["decay_rate_1_s"] == pytest.approx(0.03 * 2 * np.pi * 17.0, rel=1e-3)
    (curve,) = found.response
    modelled = found.model.linear().frequency_response(curve.frequency_hz, RATE_HZ)[:, 0, 0]
    steps = hold_response(curve.frequency_hz / RATE_HZ)
    assert np.abs(np.abs(modelled / steps) - curve.magnitude).max() < 0.01 * curve.magnitude.max()
