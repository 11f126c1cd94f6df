"""Commands that come in within a sample: exact in linear responses, and near enough in a replay."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.nominal.tuning import nuisances_of, sensitivities, turned
from sim_backend import layout
from sim_backend.assembly import Places
from sim_backend.linear import ModalModel, discretise, finer_for_delays, played
from sim_backend.replay import replay

RATE_HZ = 4000.0
FINER = 125
"""Samples of the reference in one: every delay below is a whole number of these."""


def model_late_by(samples: float) -> ModalModel:
    omega = 2.0 * np.pi * np.array([190.0, 780.0, 1200.0])
    zero = np.zeros((3, 1))
    return ModalModel(
        omega, 0.004 * omega, np.array([[160.0], [100.0], [200.0]]), zero, np.ones((1, 3)), zero.T, np.zeros((1, 1)),
        np.array([samples / RATE_HZ]),
    )  # fmt: skip


def exact(model: ModalModel, u: np.ndarray) -> np.ndarray:
    """Return the readings (n, 1) by a model FINER times as fast, in which the delay is a whole number of samples."""
    fine = discretise(model, FINER * RATE_HZ)
    assert float(fine.delay_samples[0]) == pytest.approx(round(float(fine.delay_samples[0])))
    return simulate(fine, np.repeat(u, FINER, axis=0))[::FINER]


def replayed(model: ModalModel, u: np.ndarray) -> np.ndarray:
    """Return the readings (n, 1) of a replay without effects."""
    one = np.eye(1)
    places = Places(("x",), ("x",), (), (), np.zeros((0, 1)), np.zeros((0, 1)), one)
    own = layout.Transducers(one, one, one, one, np.array([293.15, 0.0, 1.0, 1.0, 0.0]))
    return replay(model, (), places, own, u, RATE_HZ).reading


@pytest.mark.parametrize("late", [0.2, 0.56, 1.912, 2.4])
def test_a_command_that_comes_in_within_a_sample_is_as_if_played_at_a_finer_rate(late: float) -> None:
    u = np.random.default_rng(3).standard_normal((3000, 1))
    model = model_late_by(late)
    assert finer_for_delays(model, RATE_HZ) > 1
    wanted = exact(model, u)
    np.testing.assert_allclose(simulate(played(model, RATE_HZ), u), wanted, atol=1e-9 * np.std(wanted))
    assert np.std(replayed(model, u) - wanted) < 1e-4 * np.std(wanted)


def test_sensitivities_are_those_of_the_exact_model() -> None:
    u = np.random.default_rng(4).standard_normal((2000, 1))
    model = model_late_by(1.912)
    nuisances = nuisances_of(model, 0.03)
    found = sensitivities(model, nuisances, u, RATE_HZ, np.zeros((3, 2)))
    for k in range(len(nuisances)):
        up, down = (exact(turned(model, [nuisances[k]], np.array([by])), u) for by in (1e-5, -1e-5))
        np.testing.assert_allclose(found[:, :, k], (up - down) / 2e-5, atol=1e-5 * float(np.std(found[:, :, k])))


def test_whole_delays_are_played_at_the_rate_of_the_record() -> None:
    assert finer_for_delays(model_late_by(2.0), RATE_HZ) == 1


@pytest.mark.parametrize("late", [0.2, 0.56, 0.952, 2.4])
def test_jumps_of_a_command_reach_slow_modes_when_they_come_in(late: float) -> None:
    """However slow the modes are: a jump that is spread over samples moves their readings at these samples."""
    u, model = np.random.default_rng(5).standard_normal((3000, 1)), model_late_by(late)
    slow = model.with_(omega_rad_s=model.omega_rad_s / 20.0, sigma_1_s=model.sigma_1_s / 20.0)
    wanted = exact(slow, u)
    np.testing.assert_allclose(simulate(played(slow, RATE_HZ), u), wanted, atol=1e-9 * np.std(wanted))
    assert np.std(replayed(slow, u) - wanted) < 4e-5 * np.std(wanted)
