"""What each test's result is compared with: the requirements of Table 6.6 and the sensor budget of section 6.1.2.

Every function takes a measurement and returns its checks; a check without a limit is shown and cannot fail. Values
are in SI with their unit named, for whoever prints them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis.measurements.chop import ChopStability
from analysis.measurements.endstop import NOISE_LIMIT_M
from analysis.measurements.loops import Loop
from analysis.measurements.thermal import SweepDifference
from analysis.recorded.chop import TIP_TILT
from analysis.recorded.drift import DriftTest
from analysis.recorded.sensors import EndstopTest, TheodoliteTest
from analysis.recorded.settle import SettleTest

STABILITY_RAD = 1.7e-6
REPEATABILITY_RAD = 1.7e-6
ACCURACY_RAD = 85e-6
SETTLING_S = 5e-3
POWER_W = 1.0
PEAK_CURRENT_A = 10.0
PARASITIC_Z_M = 200e-6
THERMAL_STABILITY_RAD = 1.7e-6
FULL_ANGLE_RAD = 8.5e-3


@dataclass(frozen=True)
class Check:
    """One number of a test: its `value` and largest allowed `limit` (None: shown only) in `unit`."""

    name: str
    value: float
    unit: str
    limit: float | None = None

    @property
    def ok(self) -> bool:
        """Whether the value keeps its limit; a value that is not a number keeps none."""
        return self.limit is None or bool(self.value <= self.limit)


def endstop_checks(test: EndstopTest) -> tuple[Check, ...]:
    """Return the 3σ noise of the worst sensor in every position; section 6.1.2."""
    worst = test.noise.three_sigma_m.max(axis=1)
    return tuple(
        Check(f"sensor noise 3σ at {position}", float(value), "m", NOISE_LIMIT_M)
        for position, value in zip(test.positions, worst, strict=True)
    )


def theodolite_checks(test: TheodoliteTest) -> tuple[Check, ...]:
    """Return gain corrections and the error they mean at the full angle, compared with the accuracy of Table 6.6."""
    fit = test.calibration
    rows = []
    for i, dof in enumerate(TIP_TILT):
        gain, std = float(fit.gain_correction[i]), float(fit.gain_correction_std[i])
        rows += [
            Check(f"gain correction {dof}", gain, "1"),
            Check(f"its standard deviation {dof}", std, "1"),
            Check(f"error at 8.5 mrad {dof}", abs(gain) * FULL_ANGLE_RAD, "rad", ACCURACY_RAD),
        ]
    return tuple(rows)


def hysteresis_checks(loops: Mapping[float, Loop]) -> tuple[Check, ...]:
    """Return remanence and loss of every loop; nothing is required of them."""
    return tuple(
        check
        for torque_nm, one in loops.items()
        for check in (
            Check(f"remanence at {torque_nm:g} N m", one.remanence_ratio, "1"),
            Check(f"energy per cycle at {torque_nm:g} N m", one.area_j, "J"),
        )
    )


def chop_checks(result: ChopStability) -> tuple[Check, ...]:
    """Return stability, repeatability and accuracy of both positions, Table 6.6, and the percentages of Table 6.7."""
    rows = []
    for i in range(result.inside_percent.size):
        where = f"position {i + 1}"
        rows += [
            Check(f"stability 3σ θx, {where}", float(result.three_sigma_rad[i, 0]), "rad", STABILITY_RAD),
            Check(f"stability 3σ θy, {where}", float(result.three_sigma_rad[i, 1]), "rad", STABILITY_RAD),
            Check(f"inside 1.7 µrad, {where}", float(result.inside_percent[i]), "%"),
            Check(f"repeatability, {where}", float(result.repeatability_rad[i]), "rad", REPEATABILITY_RAD),
            Check(f"accuracy, {where}", float(result.accuracy_rad[i]), "rad", ACCURACY_RAD),
        ]
    return tuple(rows)


def settling_checks(test: SettleTest) -> tuple[Check, ...]:
    """Return settling and overshoot of every moved axis, stability, power, peak current and parasitic z; Table 6.6."""
    rows = []
    for dof, result in test.moved.items():
        for i in range(result.time_s.size):
            rows += [
                Check(f"settling {dof}, position {i + 1}", float(result.time_s[i]), "s", SETTLING_S),
                Check(f"overshoot {dof}, position {i + 1}", float(result.overshoot[i]), "rad"),
            ]
    rows.append(Check("stability 3σ", test.stability.stability_rad, "rad", STABILITY_RAD))
    if test.power is not None:
        rows += [
            Check("power", test.power.total_w, "W", POWER_W),
            Check("peak current", test.power.peak_a, "A", PEAK_CURRENT_A),
        ]
    if test.parasitic_z_m is not None:
        rows.append(Check("parasitic z", test.parasitic_z_m, "m", PARASITIC_Z_M))
    return tuple(rows)


def drift_checks(test: DriftTest) -> tuple[Check, ...]:
    """Return the drift of both positions over the test, Table 6.6, and how far it is known."""
    rows = []
    for i, one in enumerate(test.drift):
        rows += [
            Check(f"drift, position {i + 1}", float(np.max(np.abs(one.total_rad))), "rad", THERMAL_STABILITY_RAD),
            Check(f"its 95 % half width, position {i + 1}", float(np.max(one.half_width_rad)), "rad"),
        ]
    if test.warming_k is not None:
        rows.append(Check("warming", test.warming_k, "K"))
    return tuple(rows)


def sweep_checks(dof: str, difference: SweepDifference) -> tuple[Check, ...]:
    """Return the largest difference of two sweeps, and how surely they differ; the paper saw none and set no limit."""
    return (
        Check(f"largest difference {dof}", abs(difference.largest_db), "dB"),
        Check(f"confidence that {dof} differs", 1.0 - difference.p_value, "1"),
    )
