"""What swings on from the start of a periodic record is taken out of it, and nothing else is."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.identification.realisations import Realisations
from analysis.identification.swing import without_swing
from analysis.linear.simulate import simulate_linear
from sim_backend.linear import ModalModel, discretise

RATE_HZ, PERIOD, PERIODS = 500.0, 500, 4
NOISE = 1e-4


def plant(decay_1_s: float) -> ModalModel:
    omega, one, zero = 2 * np.pi * 12.0, np.ones((1, 1)), np.zeros((1, 1))
    return ModalModel(np.array([omega]), np.array([decay_1_s]), omega**2 * one, zero, one, zero, zero, np.zeros(1))


def record(model: ModalModel, *, settled: bool) -> tuple[Realisations, np.ndarray]:
    """Four periods of a multisine from rest, or after twenty that nobody recorded, and the same without noise."""
    rng = np.random.default_rng(2)
    at = np.arange(PERIOD) / PERIOD
    one = sum(np.cos(2 * np.pi * (k * at + rng.uniform())) for k in range(1, 60))
    before = 20 if settled else 0
    u = np.tile(one, before + PERIODS)[:, None]
    y = simulate_linear(discretise(model, RATE_HZ), u)[before * PERIOD :]
    noisy = y + NOISE * rng.standard_normal(y.shape)
    inputs, outputs = (x.reshape(PERIODS, PERIOD, 1, 1).transpose(1, 2, 3, 0) for x in (u[before * PERIOD :], noisy))
    steady = simulate_linear(discretise(model, RATE_HZ), np.tile(one, 200)[:, None])[-PERIOD:]
    return Realisations(inputs, outputs, RATE_HZ, 1), steady


@pytest.mark.parametrize("decay_1_s", [0.3, 1.1, 3.0])
def test_periods_differ_by_noise_alone_afterwards(decay_1_s):
    model = plant(decay_1_s)
    data, steady = record(model, settled=False)
    apart = np.diff(data.outputs[:, 0, 0], axis=1)
    found = without_swing(data, model)
    assert found is not None and np.std(apart) > 3.0 * NOISE
    left = np.diff(found.outputs[:, 0, 0], axis=1)
    assert np.std(left) == pytest.approx(np.sqrt(2.0) * NOISE, rel=0.1)
    np.testing.assert_allclose(found.outputs[:, 0, 0, 2], steady[:, 0], atol=6 * NOISE)


def test_a_steady_record_keeps_its_noise():
    model = plant(1.1)
    data, _ = record(model, settled=True)
    assert without_swing(data, model) is None
