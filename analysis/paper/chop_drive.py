"""What the ideal feed-forward of the 5 Hz chop asks of the actuators: current, power, and the radius that follows."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from analysis.paper.measured import RATE_HZ
from analysis.paper.step_rows import STEP_RAD
from campaigns.strategies.design import Design
from sim_backend.kinematics import dof_from_points
from sim_backend.model import Hardware, load_model, number

Array = NDArray[np.float64]

DWELL_S = 0.1


@functools.cache
def hardware() -> Hardware:
    """Return the actuators of the bench as built."""
    found = load_model("as-built").hardware
    assert found is not None
    return found


def chop_forces(model: str, samples: int) -> Array:
    """Return the actuators' forces (n, 3) in N over a period of 8.5 mrad in θx, at a radius of 1 m.

    By (6.2) forces go with 1/radius. The feed-forward of so many samples is designed on `model`; no feedback acts.
    """
    move = Design.load(model, RATE_HZ).unit_step("theta_x", samples).scaled(STEP_RAD)
    up = np.concatenate([move.drive[:, 0], np.full(round(DWELL_S * RATE_HZ) - samples, move.holding[0])])
    return np.concatenate([up, move.holding[0] - up])[:, None] * dof_from_points(1.0)[0]


def radius_for_current(model: str, samples: int, peak_a: float) -> float:
    """Return the actuators' radius (m) at which the busiest of them peaks at this current."""
    return float(np.max(np.abs(chop_forces(model, samples)))) / (number(hardware().force_constant_n_a) * peak_a)


def peak_current_a(model: str, samples: int, radius_m: float) -> float:
    """Return the peak current of the busiest actuator."""
    return radius_for_current(model, samples, 1.0) / radius_m


def power_w(model: str, samples: int, radius_m: float) -> float:
    """Return the mean dissipation of all coils."""
    per_root_watt = number(hardware().actuator_steepness_n_sqrt_w)
    force = chop_forces(model, samples) / radius_m
    return float(np.mean(np.sum((force / per_root_watt) ** 2, axis=1)))
