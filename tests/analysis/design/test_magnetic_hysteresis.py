"""Iron from a loop fit: beside the linear springs it gives back the torque that the fit balances."""

import numpy as np

from analysis.design.magnetic_hysteresis import iron_of
from analysis.measurements.loop_fit import LoopFit, magnetisation
from analysis.recorded.loop_fit import HELD
from sim_backend.along import torque_along

PARAMETERS = {
    "pinning": 2.2e-3,
    "size": 0.99,
    "power_5": 7.3e6,
    "power_4": 2100.0,
    "power_3": -2660.0,
    "power_2": 8.2,
    "stiffness": 11.3,
    "damping": 1e-3,
    "constant": 1.6e-3,
}


def test_springs_and_effects_balance_the_torque_of_the_fit():
    fit = LoopFit(PARAMETERS, dict.fromkeys(PARAMETERS, 0.0), 0.0, 1.0, (0.0,))
    angle = 8e-3 * np.sin(np.linspace(0.0, 4.0 * np.pi, 4001))
    linear = 11.1
    added = sum(torque_along(entry, angle) for entry in iron_of(fit, "theta_x", linear, "test"))
    polynomial = sum(PARAMETERS[f"power_{p}"] * angle**p for p in (5, 4, 3, 2))
    loop = PARAMETERS["size"] * magnetisation(angle, {**HELD, "pinning": PARAMETERS["pinning"]})
    drive = PARAMETERS["stiffness"] * angle - loop - polynomial - PARAMETERS["constant"]
    # what the drive has to give: the linear spring, less what the iron adds
    np.testing.assert_allclose(linear * angle - added, drive, atol=1e-15)
