"""The hybrid strategy: the feed-forward alone drives the move, then the feedback closes at the set point.

The feedback never sees the move, so it adds nothing to it. At arrival its integrator starts from the input
that holds the new set point, its other states from zero; with a perfect model it then stands still. The
feed-forward keeps the difference between the input wanted and the integrator's start, which is zero once the
input has come to rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_backend.bench import Gate
from sim_backend.control.chop import AxisProgram, Chop
from sim_backend.control.feedforward import StepInput
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]


def hybrid(chop: Chop, unit_step: StepInput, axis: int) -> AxisProgram:
    """Return the period of an axis under the hybrid strategy from the input for a move of 1.

    Raises ConfigError when the move does not fit into a dwell. Source: section 6.3.1.
    """
    return hybrid_from_input(chop, chop.input(unit_step), unit_step.arrival, axis)


def hybrid_from_input(chop: Chop, drive: Array, arrival: int, axis: int) -> AxisProgram:
    """Return the hybrid period from a whole period of input (period,), a learned one also (section 6.5).

    `arrival` is the sample of each dwell at which the feedback closes; the integrator starts from the input
    at the dwell's end. Raises ConfigError when shapes differ or the arrival lies outside the dwell.
    """
    if drive.shape != (chop.period,) or not 0 < arrival < chop.dwell_samples:
        raise ConfigError(
            f"hybrid: input of {drive.shape} samples and arrival {arrival} do not fit a period of {chop.period} "
            f"with dwells of {chop.dwell_samples}; give one whole period and an arrival within the dwell"
        )
    feedforward = np.array(drive)
    gates: list[Gate] = []
    for first, _, _ in chop.moves():
        end = first + chop.dwell_samples
        start = float(drive[end - 1])
        feedforward[first + arrival : end] -= start
        gates += [Gate(first, axis, False), Gate(first + arrival, axis, True, start)]
    return AxisProgram(chop.levels_held(), feedforward, tuple(gates))
