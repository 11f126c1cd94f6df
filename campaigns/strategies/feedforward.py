"""The paper's strategies that know the move beforehand: hybrid and model-based feed-forward (section 6.3.1)."""

from __future__ import annotations

from campaigns.strategies.design import Design, feedback_of
from campaigns.strategies.stages import Program, Stage, Task, chop_of, held, move_samples, moving, stage_of
from sim_backend.control.chop import AxisProgram, Chop
from sim_backend.control.hybrid import hybrid
from sim_backend.control.mbff import mbff


def hybrid_stages(task: Task, design: Design) -> tuple[Stage, ...]:
    """Feed-forward alone drives the move, then the feedback closes; section 6.3.1."""
    move = move_samples(task, design)

    def program(chop: Chop, axis: int) -> AxisProgram:
        return hybrid(chop, design.unit_step(task.axes[axis], move), axis)

    return _approach_and_chop(task, design, program)


def mbff_stages(task: Task, design: Design) -> tuple[Stage, ...]:
    """Feed-forward added to a loop that stays closed; the conventional strategy."""
    move = move_samples(task, design)

    def program(chop: Chop, axis: int) -> AxisProgram:
        dof = task.axes[axis]
        return mbff(chop, design.axis(dof), design.unit_step(dof, move), axis)

    return _approach_and_chop(task, design, program)


def _approach_and_chop(task: Task, design: Design, program: Program) -> tuple[Stage, ...]:
    """One dwell to move to position 1 from zero, by the same strategy, then the chop."""
    feedback = tuple(feedback_of(dof, design.rate_hz) for dof in task.axes)
    approach, chop = [], []
    for axis, moves in enumerate(moving(task)):
        there = chop_of(task, design, axis)
        first = Chop((there.levels[1], 0.0), task.dwell_samples, design.rate_hz)
        approach.append(program(first, axis) if moves else held(first, axis))
        chop.append(program(there, axis) if moves else held(there, axis))
    return stage_of("approach", task.dwell_samples, approach, feedback), stage_of("chop", None, chop, feedback)
