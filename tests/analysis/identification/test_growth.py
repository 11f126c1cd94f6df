"""A chirp's modes: starts for all blocks at once may miss them; one more where the last fit leaves most does not."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.identification.determined import without_undetermined
from analysis.identification.growth import grown
from analysis.identification.time_residual import TimeTarget
from analysis.identification.timefit import fit_records
from analysis.linear.simulate import simulate_linear
from sim_backend.linear import ModalModel, discretise

RATE_HZ, ROWS = 200.0, 1024
MODES_HZ = np.array([5.3, 11.9])


def bench() -> ModalModel:
    omega = 2.0 * np.pi * MODES_HZ
    return ModalModel(
        omega_rad_s=omega,
        sigma_1_s=np.array([0.02, 0.04]) * omega,
        b=np.ones((2, 1)),
        b_direct=np.zeros((2, 1)),
        c=np.array([[1.0, -0.4]]) * omega**2,
        c_rate=np.zeros((1, 2)),
        d=np.zeros((1, 1)),
        delay_s=np.zeros(1),
    )


def chirp() -> np.ndarray:
    """From 1 to 21 Hz: nothing is played in four fifths of the band."""
    t = np.arange(ROWS) / RATE_HZ
    return np.sin(2.0 * np.pi * (t + 10.0 * t**2 * RATE_HZ / ROWS))[:, None]


@pytest.mark.parametrize("missing", [0, 1])
def test_a_new_block_stands_where_a_mode_is_missing(missing: int) -> None:
    u = chirp()
    y = simulate_linear(discretise(bench(), RATE_HZ), u)
    y += 0.02 * y.std() * np.random.default_rng(1).standard_normal(y.shape)
    less = bench().only(np.arange(2) != missing)
    model = grown(
        TimeTarget((u,), (y,), RATE_HZ, np.ones((1, 1))),
        less,
        [simulate_linear(discretise(less, RATE_HZ), u)],
        2,
        mechanical=True,
    )
    assert model.omega_rad_s[1] / (2.0 * np.pi) == pytest.approx(MODES_HZ[missing], rel=0.05)
    assert np.sign(model.c[0, 1] * model.b[1, 0]) == np.sign(bench().c[0, missing])
    assert model.c_rate[0, 1] == 0.0


def test_blocks_of_several_inputs_and_outputs_grow_one_after_the_other() -> None:
    rng = np.random.default_rng(2)
    u = rng.standard_normal((4000, 2))
    true = bench().with_(
        b=np.array([[1.0, 0.3], [-0.5, 1.0]]),
        b_direct=np.zeros((2, 2)),
        c=np.array([[1.0, 0.2], [0.4, -1.0]]) * bench().omega_rad_s ** 2,
        c_rate=np.zeros((2, 2)),
        d=np.zeros((2, 2)),
        delay_s=np.zeros(2),
    )
    y = simulate_linear(discretise(true, RATE_HZ), u)
    none = true.only(np.zeros(2, dtype=bool))
    model = grown(TimeTarget((u,), (y,), RATE_HZ, np.ones((2, 1))), none, [np.zeros_like(y)], 2, mechanical=False)
    assert np.sort(model.omega_rad_s) / (2.0 * np.pi) == pytest.approx(MODES_HZ, rel=0.05)
    left = y - simulate_linear(discretise(model, RATE_HZ), u)
    assert np.std(left) < 0.7 * np.std(y)


@pytest.mark.parametrize(("low_hz", "high_hz", "share"), [(7.5, 13.0, -0.42), (7.83, 11.8, 0.57), (5.94, 11.12, -0.64)])
def test_both_modes_of_a_chirp_are_found(low_hz: float, high_hz: float, share: float) -> None:
    """Before growth the last two of these came out with one mode."""
    rng = np.random.default_rng(3)
    omega = 2.0 * np.pi * np.array([low_hz, high_hz])
    true = bench().with_(
        omega_rad_s=omega, sigma_1_s=np.array([0.02, 0.04]) * omega, c=np.array([[1.0, share]]) * omega**2
    )
    u = chirp()[:768]
    y = simulate_linear(discretise(true, RATE_HZ), u)
    y += 0.02 * y.std() * rng.standard_normal(y.shape)
    orders = (1, 2, 3, 4)
    fit = without_undetermined(
        fit_records([u], [y], RATE_HZ, orders, rigid_bodies=None),
        orders,
        lambda n, start: fit_records([u], [y], RATE_HZ, n, rigid_bodies=None, start=start),
    )
    assert np.sort(fit.model.omega_rad_s) / (2.0 * np.pi) == pytest.approx([low_hz, high_hz], rel=2e-3)
