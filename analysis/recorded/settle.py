"""A recorded fast chop: settling of every moved axis, stability, power and parasitic motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.chop import ChopStability
from analysis.measurements.power import CoilPower
from analysis.measurements.settling import Settling
from analysis.recorded.chop import TIP_TILT, chop_phase
from campaigns.playing.recording import Recorded
from sim_backend.errors import DataError

Array = NDArray[np.float64]

FORCE_CONSTANT_N_A = 5.7
STEEPNESS_N_SQRT_W = 7.9
"""Actuators: force per ampere, and per root of watt (section 6.2.1)."""

NEGLIGIBLE_RAD = 1e-9
"""What rounding of a direction may leave of a move: far below any, and a thousandth of the band."""


@dataclass(frozen=True)
class SettleTest:
    """What a fast chop shows; `moved` holds the settling to positions 1 and 2 by axis, for the axes that move.

    `power` is None where no currents were recorded, `parasitic_z_m` (largest excursion of z) where no z was.
    """

    moved: dict[str, Settling]
    stability: ChopStability
    power: CoilPower | None
    parasitic_z_m: float | None

    @property
    def settling_s(self) -> float:
        """The longest settling of all moves. Raises DataError where nothing moves."""
        if not self.moved:
            raise DataError(
                f"the two positions of this chop are less than {NEGLIGIBLE_RAD * 1e9:g} nrad apart on every axis, so "
                "that nothing settles; set from_rad and to_rad farther apart"
            )
        return max(float(np.max(result.time_s)) for result in self.moved.values())


def settle_of(run: Recorded) -> SettleTest:
    """Return the settling of a recorded chop, its learning left out; Tables 6.5 and 6.6.

    Raises DataError for a log without a chop of two cycles.
    """
    phase = chop_phase(run)
    moves = np.ptp(phase.commanded_rad, axis=0) > NEGLIGIBLE_RAD
    currents = any(name.startswith("current_") for name in run.channels)
    return SettleTest(
        moved={dof: phase.settling(dof) for dof, moving in zip(TIP_TILT, moves, strict=True) if moving},
        stability=phase.stability(),
        power=phase.power(FORCE_CONSTANT_N_A, STEEPNESS_N_SQRT_W) if currents else None,
        parasitic_z_m=phase.largest("z") if "z" in run.channels else None,
    )
