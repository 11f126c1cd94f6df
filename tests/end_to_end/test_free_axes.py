"""Several drives, or several readings of one, on what nothing holds: verdicts by axis, and what rubs is named there.

The benches are integrated by formulas of their own; numbers and seeds were fixed before any of these records was
diagnosed, after others of their kind had been.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.end_to_end.linear_bench import Record, moves
from tests.end_to_end.unknown_bench import diagnosis, identified, imported, write_record

Array = NDArray[np.float64]

RATE_HZ, ROWS, NOISE, FINER = 800.0, 9000, 2e-5, 16
INERTIA, DRAG = (1.7e-3, 0.9e-3), (7e-3, 5e-3)

pytestmark = pytest.mark.slow


def stage(seed: int, friction: tuple[float, float] = (0.0, 0.0), coupling: float = 0.0) -> tuple[Array, Array]:
    """Return drives and readings (n, 2) of two axes in loops that answer at once; the second drive turns the first."""
    rng = np.random.default_rng(seed)
    reference = np.stack([moves(rng, ROWS, RATE_HZ) for _ in range(2)], axis=1)
    inertia, drag, rubs = np.array(INERTIA), np.array(DRAG), np.array(friction)
    stiff = inertia * (2.0 * np.pi * 7.0) ** 2
    x, v, before, u, y = np.zeros(2), np.zeros(2), np.zeros(2), np.empty((ROWS, 2)), np.empty((ROWS, 2))
    h = 1.0 / RATE_HZ / FINER
    for k in range(ROWS):
        y[k] = x + NOISE * rng.standard_normal(2)
        error = reference[k] - y[k]
        u[k] = stiff * (error + 0.03 * (error - before) * RATE_HZ)
        before = error
        torque = u[k] + np.array([coupling * u[k, 1], 0.0])
        for _ in range(FINER):  # midpoint rule
            half = v + 0.5 * h * (torque - drag * v - rubs * np.tanh(v / 2e-3)) / inertia
            x = x + h * half
            v = v + h * (torque - drag * half - rubs * np.tanh(half / 2e-3)) / inertia
    return u, y


def geared(seed: int, friction: float) -> tuple[Array, Array]:
    """Return the drive (n, 1) and what is read before and behind a shaft (n, 2); the motor rubs."""
    rng = np.random.default_rng(seed)
    reference = moves(rng, ROWS, RATE_HZ)
    x, v, before = np.zeros(2), np.zeros(2), 0.0
    u, y = np.empty((ROWS, 1)), np.empty((ROWS, 2))
    shaft, loss, h = 110.0, 0.015, 1.0 / RATE_HZ / FINER
    stiff = sum(INERTIA) * (2.0 * np.pi * 5.0) ** 2
    for k in range(ROWS):
        y[k] = x + NOISE * rng.standard_normal(2)
        error = reference[k] - y[k, 0]
        u[k, 0] = stiff * (error + 0.04 * (error - before) * RATE_HZ)
        before = error
        for _ in range(FINER):
            half = v + 0.5 * h * _turned(x, v, u[k, 0], shaft, loss, friction)
            middle = x + 0.5 * h * v
            v = v + h * _turned(middle, half, u[k, 0], shaft, loss, friction)
            x = x + h * half
    return u, y


def _turned(x: Array, v: Array, torque: float, shaft: float, loss: float, friction: float) -> Array:
    through = shaft * (x[0] - x[1]) + loss * (v[0] - v[1])
    motor = torque - through - DRAG[0] * v[0] - friction * np.tanh(v[0] / 2e-3)
    return np.array([motor / INERTIA[0], (through - DRAG[1] * v[1]) / INERTIA[1]])


def diagnosed(folder: Path, u: Array, y: Array) -> dict[str, Any]:
    """Return the diagnosis of drives (n, k) and readings (n, 2) whose last quarter is held out."""
    split = 3 * ROWS // 4
    write_record(folder, Record(u, y, RATE_HZ, [("train", split), ("held-out end", ROWS - split)], None))
    imported(folder)
    identified(folder)
    return diagnosis(folder, "--page")  # one of a bench with several axes


def causes(found: dict[str, Any]) -> dict[tuple[str, str], dict[str, float]]:
    return {(c["effect"], c["where"]): {k: e["value"] for k, e in c["parameters"].items()} for c in found["causes"]}


def test_two_axes_of_which_one_drive_turns_both_are_consistent(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, *stage(721, coupling=0.05))
    assert (found["verdict"], causes(found)) == ("consistent", {}), found["sentence"]


def test_friction_is_named_at_the_axis_that_rubs(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, *stage(722, friction=(0.0, 4e-3)))
    assert found["verdict"] == "named", found["sentence"]
    assert set(causes(found)) == {("coulomb-friction", "x2")}
    assert causes(found)["coulomb-friction", "x2"]["torque"] == pytest.approx(4e-3, rel=0.01)
    assert found["gain"]["rms_after"] < 0.1 * found["gain"]["rms_before"]


def test_friction_is_named_at_both_axes(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, *stage(723, friction=(6e-3, 3e-3)))
    assert found["verdict"] == "named", found["sentence"]
    assert set(causes(found)) == {("coulomb-friction", "x1"), ("coulomb-friction", "x2")}
    assert causes(found)["coulomb-friction", "x1"]["torque"] == pytest.approx(6e-3, rel=0.01)
    assert causes(found)["coulomb-friction", "x2"]["torque"] == pytest.approx(3e-3, rel=0.01)


def test_friction_is_named_where_motor_and_load_are_read(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, *geared(724, friction=0.012))
    assert found["verdict"] == "named", found["sentence"]
    assert ("coulomb-friction", "x1") in causes(found)
    assert causes(found)["coulomb-friction", "x1"]["torque"] == pytest.approx(0.012, rel=0.02)
    assert found["gain"]["rms_after"] < 0.2 * found["gain"]["rms_before"]
