"""Model-based feed-forward added to a loop that stays closed: the conventional strategy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sim_backend.bench import Gate
from sim_backend.control.chop import AxisProgram, Chop
from sim_backend.control.feedforward import StepInput, step_response
from sim_backend.linear import ModalModel, discretise

Array = NDArray[np.float64]


def mbff(chop: Chop, model: ModalModel, unit_step: StepInput, axis: int) -> AxisProgram:
    """Return the period of an axis whose feedback is always closed, fed forward by `unit_step` (a move of 1).

    The reference is what the design model does under that input: a perfect plant then leaves the feedback
    nothing to do during the move. Raises ConfigError when the move does not fit into a dwell. Source: chapter
    3's MbFF as used in section 6.5.
    """
    response = step_response(discretise(model, chop.rate_hz), unit_step, chop.dwell_samples)[:, 0]
    reference = np.empty(chop.period)
    for first, before, after in chop.moves():
        reference[first : first + chop.dwell_samples] = before + (after - before) * response
    return mbff_from_input(chop.input(unit_step), reference, axis)


def mbff_from_input(drive: Array, reference: Array, axis: int) -> AxisProgram:
    """Return the closed-loop period of an axis from one of input and of reference (period,), learned or not."""
    return AxisProgram(reference, drive, (Gate(0, axis, True, 0.0),))
