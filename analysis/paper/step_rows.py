"""The plants of Table 6.4 and how each takes a step of 8.5 mrad under a feed-forward."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from analysis.linear.simulate import simulate_linear
from analysis.measurements.settling import Settling, settling
from analysis.paper.measured import RATE_HZ
from campaigns.strategies.design import Design
from sim_backend.control.feedforward import StepInput
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]

STEP_RAD = 8.5e-3

DURATION_S = 1.2
"""Three times as long as the slowest mode of the table takes to settle."""

PLANTS = {
    "2": "table-6.4-30",
    "30+125": "table-6.4-30-125",
    "30+500": "table-6.4-30-500",
    "30+1500": "table-6.4-30-1500",
    "complete": "design",
}
"""Design models by the key of their row; the feed-forward is designed on the first one."""


def step_response(model: ModalModel, unit_move: StepInput) -> Array:
    """Return the output (n,) of a plant from rest under the input for a move of 8.5 mrad."""
    move = unit_move.scaled(STEP_RAD)
    rest = round(DURATION_S * move.rate_hz) - move.drive.shape[0]
    drive = np.concatenate([move.drive, np.tile(move.holding, (rest, 1))])
    return simulate_linear(discretise(model, move.rate_hz), drive)[:, 0]


def step_settling(model: ModalModel, unit_move: StepInput) -> Settling:
    """Return overshoot and settling of that response towards 8.5 mrad."""
    return settling(step_response(model, unit_move), unit_move.rate_hz, STEP_RAD)


def plant_of(key: str) -> ModalModel:
    """Return the θx plant of a row of Table 6.4."""
    return Design.load(PLANTS[key], RATE_HZ).axis("theta_x")


def rows_under(unit_move: StepInput) -> dict[str, tuple[float, float]]:
    """Return overshoot (rad) and settling (s) of every plant of Table 6.4 under one feed-forward."""
    found = {key: step_settling(plant_of(key), unit_move) for key in PLANTS}
    return {key: (float(one.overshoot[0]), float(one.time_s[0])) for key, one in found.items()}


@functools.cache
def rows_at(samples: int) -> dict[str, tuple[float, float]]:
    """Return the same under the least-norm feed-forward of so many samples for the 2nd-order plant; keep it."""
    return rows_under(Design.load(PLANTS["2"], RATE_HZ).unit_step("theta_x", samples))
