"""Several drives at once: whose reading is whose, what one drive adds to another axis, and what stands beside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.identification.axes import moved_by
from analysis.identification.identified import Identification
from analysis.identification.identify import identify_runs
from campaigns.log import read_run
from sim_backend.linear import ModalModel
from sim_backend.model import Quantity, Value
from tests.end_to_end.linear_bench import Record, held, moves
from tests.end_to_end.unknown_bench import imported, write_record

Array = NDArray[np.float64]

RATE_HZ, ROWS, NOISE = 500.0, 4000, 2e-5
INERTIA, DRAG = np.array([1.4e-3, 2.3e-3]), np.array([5e-3, 8e-3])
COUPLING = 0.04
FRICTION = 7e-3


def played(seed: int, coupling: float = 0.0, friction: float = 0.0, push: float = 0.0) -> tuple[Array, Array]:
    """Return drives and readings (n, 2) of two free axes under loops of their own that answer at once.

    The first axis gets a part `coupling` of the second drive and a torque `push`, the second one rubs by `friction`.
    """
    rng = np.random.default_rng(seed)
    reference = np.stack([moves(rng, ROWS, RATE_HZ) for _ in range(2)], axis=1)
    fine = 8 if friction else 1
    steps = [
        held(np.array([[0.0, 1.0], [0.0, -drag / inertia]]), np.array([[0.0], [1.0 / inertia]]), fine * RATE_HZ)
        for inertia, drag in zip(INERTIA, DRAG, strict=True)
    ]
    stiff = INERTIA * (2.0 * np.pi * 6.0) ** 2
    x, before, u, y = np.zeros((2, 2)), np.zeros(2), np.empty((ROWS, 2)), np.empty((ROWS, 2))
    for k in range(ROWS):
        y[k] = x[:, 0] + NOISE * rng.standard_normal(2)
        error = reference[k] - y[k]
        u[k] = stiff * (error + 0.04 * (error - before) * RATE_HZ)
        before = error
        for _ in range(fine):
            torque = np.array([u[k, 0] + coupling * u[k, 1] + push, u[k, 1] - friction * np.tanh(x[1, 1] / 2e-3)])
            for axis, (over, into) in enumerate(steps):
                x[axis] = over @ x[axis] + into[:, 0] * torque[axis]
    return u, y


def logged(folder: Path, u: Array, y: Array) -> Path:
    """Return the log of drives (n, k) and readings (n, m), imported as a user does."""
    split = 3 * ROWS // 4
    write_record(folder, Record(u, y, RATE_HZ, [("train", split), ("held-out end", ROWS - split)], None))
    imported(folder)
    return folder / "run.h5"


def identified(log: Path, modes: int) -> Identification:
    with read_run(log) as run:
        return identify_runs([run], modes=modes)


def gains(model: ModalModel) -> Array:
    """Return c b (n_y, n_u): what a steady torque of each drive accelerates each reading by, all axes being free."""
    return model.c @ model.b


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_every_drive_gets_the_reading_that_it_moves(order: tuple[int, int]) -> None:
    u, y = played(1)
    moved = moved_by([u], [y[:, list(order)]], RATE_HZ)
    assert moved is not None
    assert [one.readings for one in moved] == [[order.index(0)], [order.index(1)]]
    assert all(one.balance is not None and one.balance.free for one in moved)


def test_two_readings_of_one_drive_are_both_its() -> None:
    u, y = played(2)
    rng = np.random.default_rng(9)
    far = 0.5 * y[:, :1] + 0.3 + 10.0 * NOISE * rng.standard_normal((ROWS, 1))
    moved = moved_by([u], [np.hstack([far, y[:, 1:], y[:, :1]])], RATE_HZ)
    assert moved is not None
    assert [one.readings for one in moved] == [[2, 0], [1]]  # the quieter first


def test_fewer_readings_than_drives_and_what_is_held_are_left_to_the_fit() -> None:
    u, y = played(3)
    assert moved_by([u], [y[:, :1]], RATE_HZ) is None
    rng = np.random.default_rng(4)
    over, into = held(np.array([[0.0, 1.0], [-((2.0 * np.pi * 30.0) ** 2), -20.0]]), np.array([[0.0], [1.0]]), RATE_HZ)
    drive, x, springs = rng.standard_normal((ROWS, 2)), np.zeros((2, 2)), np.empty((ROWS, 2))
    for k in range(ROWS):
        springs[k] = x[0]
        x = over @ x + into @ drive[k][None, :]
    assert moved_by([drive], [springs], RATE_HZ) is None


def test_what_one_drive_adds_to_another_axis_is_found_and_nothing_else(tmp_path: Path) -> None:
    found = identified(logged(tmp_path, *played(5, coupling=COUPLING)), 2)
    linear = found.model.linear()
    assert found.method == "free, axis by axis"
    assert np.all(linear.omega_rad_s == 0.0)
    expected = np.array([[1.0, COUPLING], [0.0, 1.0]]) / INERTIA[:, None]
    # noise of 2e-5 beside moves of one: parts in 1e4 of 2250 rows and more
    np.testing.assert_allclose(gains(linear), expected, rtol=2e-3, atol=1e-3 * expected.max())
    assert gains(linear)[1, 0] == 0.0
    assert 2.0 * np.sort(linear.sigma_1_s) == pytest.approx(np.sort(DRAG / INERTIA), rel=5e-3)
    assert found.held_out[0].total < 1e-3


def test_the_friction_of_one_axis_does_not_bend_the_other(tmp_path: Path) -> None:
    u, y = played(6, friction=FRICTION)
    found = identified(logged(tmp_path, u, y), 2)
    assert found.method == "free, axis by axis, beside friction"
    linear = found.model.linear()
    assert gains(linear)[0, 0] == pytest.approx(1.0 / INERTIA[0], rel=2e-3)
    # a tenth is what the start of a refit needs of a balance
    assert gains(linear)[1, 1] == pytest.approx(1.0 / INERTIA[1], rel=0.1)
    assert [(e.effect, e.where) for e in found.model.effects] == [("constant-torque", "x2")]
    moved = moved_by([u], [y], RATE_HZ)
    assert moved is not None and moved[0].balance is not None and moved[1].balance is not None
    assert moved[0].balance.friction == 0.0
    assert moved[1].balance.friction == pytest.approx(FRICTION, rel=0.1)


def fitted(value: Value) -> float:
    assert isinstance(value, Quantity)
    return value.value


def test_a_torque_that_is_always_there_stands_beside_its_axis(tmp_path: Path) -> None:
    found = identified(logged(tmp_path, *played(7, push=4e-3)), 2)
    assert found.method == "free, axis by axis, beside a constant torque"
    (point,) = found.model.effects
    assert (point.effect, point.where) == ("constant-torque", "x1")
    assert fitted(point.parameters["torque"]) == pytest.approx(4e-3, rel=1e-3)
    expected = np.diag(1.0 / INERTIA)
    np.testing.assert_allclose(gains(found.model.linear()), expected, rtol=2e-3, atol=1e-3 * expected.max())


def test_readings_of_one_body_have_zeros_of_their_own(tmp_path: Path) -> None:
    u, y = played(8)
    rng = np.random.default_rng(10)
    far = 0.5 * y[:, :1] + 0.3 + 2.0 * NOISE * rng.standard_normal((ROWS, 1))
    found = identified(logged(tmp_path, u[:, :1], np.hstack([y[:, :1], far])), 1)
    linear = found.model.linear()
    assert found.method == "free"
    assert gains(linear)[:, 0] * INERTIA[0] == pytest.approx([1.0, 0.5], rel=2e-3)
    offsets = {e.where: fitted(e.parameters["offset"]) for e in found.model.effects}
    assert offsets == {"x2": pytest.approx(0.3, abs=1e-3)}
    assert found.held_out[0].total < 1e-3
