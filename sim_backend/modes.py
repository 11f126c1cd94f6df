"""A mode as a location: what acts within the structure, where there is neither a drive nor a sensor.

Joints, ceramics and glue are deformed by every mode in its own proportion. The deflection of a mode is the length of
what it adds to the outputs, and a force on it is measured by the deflection that it holds at rest: so a stiffness in a
mode is a part of the mode's own, whatever its participations are scaled by.
"""

from __future__ import annotations

import re

import numpy as np

from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel
from sim_backend.model import Model

_MODE = re.compile(r"mode (\d+)")


def is_mode(where: str) -> bool:
    """Tell whether a location has the form of a mode's: 'mode 3' is the third in the model's file, if it has one."""
    return _MODE.fullmatch(where) is not None


def mode_of(linear: ModalModel, where: str, effect: str) -> int:
    """Return the number of a mode from zero; raises ConfigError where it is none, or a rigid body."""
    match = _MODE.fullmatch(where)
    m = int(match[1]) - 1 if match else -1
    if not (0 <= m < linear.n_blocks and linear.omega_rad_s[m] > 0.0):
        raise ConfigError(
            f"effect {effect}: '{where}' is not a mode with a stiffness; modes go from 'mode 1' to "
            f"'mode {linear.n_blocks}', without rigid bodies"
        )
    return m


def reach_of(linear: ModalModel, m: int) -> float:
    """Return the 2-norm of what a unit of mode `m` adds to the outputs; 1 where no output shows it, to divide by."""
    rate = float(linear.omega_rad_s[m] * np.linalg.norm(linear.c_rate[:, m]))
    return float(np.hypot(np.linalg.norm(linear.c[:, m]), rate)) or 1.0


def mode_alone(linear: ModalModel, m: int) -> ModalModel:
    """Return mode `m` by itself, with its deflection and the rate of that as outputs."""
    reach, none = np.array([[reach_of(linear, m)]]), np.zeros((1, 1))
    seen = {"c": np.vstack([reach, none]), "c_rate": np.vstack([none, reach]), "d": np.zeros((2, linear.n_inputs))}
    return linear.only(np.arange(linear.n_blocks) == m).with_(**seen)


def units_at(model: Model, where: str) -> tuple[str, str]:
    """Return the units of force and deflection at a location; in a mode both are that of the outputs."""
    target = where.rpartition("->")[2]
    y = next((p.unit for p in model.outputs if p.dof == target), model.outputs[0].unit)
    u = next((p.unit for p in model.inputs if p.dof == target), y if is_mode(target) else model.inputs[0].unit)
    return u, y
