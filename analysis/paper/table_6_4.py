"""Table 6.4: what modes that a feed-forward leaves out do to settling; computed from design models, without a bench."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.linear.simulate import simulate_linear
from analysis.measurements.settling import Settling, settling
from analysis.paper.measured import RATE_HZ, Measured
from analysis.paper.rows import Ours
from campaigns.strategies.design import Design
from sim_backend.control.feedforward import StepInput
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]

STEP_RAD = 8.5e-3
MOVE_SAMPLES = 50
"""The full 5 ms of the settling specification, section 6.3.1."""

DURATION_S = 1.2
"""Three times as long as the slowest mode of the table takes to settle."""

PLANTS = {
    "2": "table-6.4-30",
    "30+125": "table-6.4-30-125",
    "30+500": "table-6.4-30-500",
    "30+1500": "table-6.4-30-1500",
    "complete": "design",
}


def table_6_4(measured: Measured) -> dict[str, Ours]:
    """Return overshoot and settling of every plant under the feed-forward for the 2nd-order one; section 6.3.1."""
    ours: dict[str, Ours] = {}
    second = _plant("table-6.4-30")
    move = second.unit_step("theta_x", MOVE_SAMPLES)
    for key, name in PLANTS.items():
        result = step_settling(_plant(name).axis("theta_x"), move)
        ours[f"{key} overshoot"] = Ours(float(result.overshoot[0]))
        ours[f"{key} settling"] = Ours(float(result.time_s[0]))
    complete = _plant("design")
    own = step_settling(complete.axis("theta_x"), complete.unit_step("theta_x", MOVE_SAMPLES))
    ours["own settling"] = Ours(float(own.time_s[0]))
    return ours


def step_response(model: ModalModel, unit_move: StepInput) -> Array:
    """Return the output (n,) of a plant from rest under the input for a move of 8.5 mrad."""
    move = unit_move.scaled(STEP_RAD)
    rest = round(DURATION_S * move.rate_hz) - move.drive.shape[0]
    drive = np.concatenate([move.drive, np.tile(move.holding, (rest, 1))])
    return simulate_linear(discretise(model, move.rate_hz), drive)[:, 0]


def step_settling(model: ModalModel, unit_move: StepInput) -> Settling:
    """Return overshoot and settling of that response towards 8.5 mrad."""
    return settling(step_response(model, unit_move), unit_move.rate_hz, STEP_RAD)


def _plant(name: str) -> Design:
    return Design.load(name, RATE_HZ)
