"""A chop by feedback alone: the reference steps, nothing is fed forward."""

from __future__ import annotations

import numpy as np

from campaigns.strategies.design import Design, feedback_of
from campaigns.strategies.stages import Stage, Task, chop_of, held, moving, stage_of
from sim_backend.bench import Gate
from sim_backend.control.chop import AxisProgram, Chop


def feedback_only_stages(task: Task, design: Design) -> tuple[Stage, ...]:
    """Return one stage: every axis that moves has its loop closed from the start, and is told to step."""

    def program(chop: Chop, axis: int) -> AxisProgram:
        return AxisProgram(chop.levels_held(), np.zeros(chop.period), (Gate(0, axis, True, 0.0),))

    feedback = tuple(feedback_of(dof, design.rate_hz) for dof in task.axes)
    programs = []
    for axis, moves in enumerate(moving(task)):
        chop = chop_of(task, design, axis)
        programs.append(program(chop, axis) if moves else held(chop, axis))
    return (stage_of("chop", None, programs, feedback),)
