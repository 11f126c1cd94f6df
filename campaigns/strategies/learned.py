"""The paper's strategies that learn: repetitive control, and what it learned as a feed-forward (6.3.2, 6.5)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from campaigns.sizes import samples_of
from campaigns.strategies.design import Design, feedback_of
from campaigns.strategies.stages import Program, Stage, Task, chop_of, held, move_samples, moving, stage_of
from sim_backend.bench import Gate
from sim_backend.control.chop import AxisProgram, Chop
from sim_backend.control.profile import MotionLimits

Array = NDArray[np.float64]

LEARNING_S = {"theta_x": 10.0, "theta_y": 4.7}
"""How long an axis learns before its feedback closes, in s.

θy: printed (section 6.3.2). θx: assumed. At rest the error shrinks by 1 − k_r per period, so that with the printed
k_r = 0.1 the 23 periods of 4.7 s would leave 9 % of it; "after 10 seconds of chopping" (section 6.5) is the only
other time of learning in the paper.
"""


def repetitive_stages(task: Task, design: Design) -> tuple[Stage, ...]:
    """Learn the input with the feedback open, then close it around the learned input; section 6.3.2."""
    return _learn_then(task, design, _always_closed(task), task.tuning.feedback_factor)


def learned_mbff_stages(task: Task, design: Design) -> tuple[Stage, ...]:
    """The learned input as the feed-forward of MbFF; section 6.5."""
    return _learn_then(task, design, _always_closed(task), 1.0)


def learned_hybrid_stages(task: Task, design: Design) -> tuple[Stage, ...]:
    """The learned input as the feed-forward of the hybrid strategy; section 6.5.

    The learned input plays on in the dwell and holds the position there, so the integrator starts from zero.
    """
    arrival = move_samples(task, design)

    def program(chop: Chop, axis: int) -> AxisProgram:
        starts = [first for first, _, _ in chop.moves()]
        gates = [g for s in starts for g in (Gate(s, axis, False), Gate(s + arrival, axis, True, 0.0))]
        return AxisProgram(chop.levels_held(), np.zeros(chop.period), tuple(gates))

    return _learn_then(task, design, program, 1.0)


def move_profile_limits(distance: float, move_s: float, rate_hz: float) -> MotionLimits:
    """Return limits under which a fourth-order move over `distance` takes at most `move_s`, only its snap being bound.

    Eight equal stretches of t whole samples: x = 8 d t⁴ (Lambrechts et al., 2005).
    """
    free = 1e30
    t_s = max(int(move_s * rate_hz / 8.0 + 1e-9), 1) / rate_hz
    return MotionLimits(free, free, free, abs(distance) / (8.0 * t_s**4) if distance else 1.0)


def _always_closed(task: Task) -> Program:
    def program(chop: Chop, axis: int) -> AxisProgram:
        return AxisProgram(_profile(task, chop), np.zeros(chop.period), (Gate(0, axis, True, 0.0),))

    return program


def _profile(task: Task, chop: Chop) -> Array:
    return chop.profile(move_profile_limits(chop.levels[0] - chop.levels[1], task.tuning.move_s, chop.rate_hz))


def _learn_then(task: Task, design: Design, program: Program, factor: float) -> tuple[Stage, ...]:
    tuning = task.tuning
    movers = [dof for dof, moves in zip(task.axes, moving(task), strict=True) if moves]
    learning_s = tuning.learning_s or max(LEARNING_S.get(dof, 0.0) for dof in movers)
    n_learning = samples_of(learning_s, design.rate_hz)
    learn, after, learning, frozen, feedback, final = [], [], [], [], [], []
    for axis, (dof, moves) in enumerate(zip(task.axes, moving(task), strict=True)):
        chop = chop_of(task, design, axis)
        quiet = AxisProgram(_profile(task, chop), np.zeros(chop.period), (Gate(0, axis, False),))
        learn.append(quiet if moves else held(chop, axis))
        after.append(program(chop, axis) if moves else held(chop, axis))
        one = design.learning(dof, task.period, tuning.learning_modes) if moves else None
        learning.append(one)
        frozen.append(one if one is None else replace(one, active=tuning.keeps_learning))
        feedback.append(feedback_of(dof, design.rate_hz))
        final.append(feedback_of(dof, design.rate_hz, factor if moves else 1.0))
    shift = n_learning % task.period
    return (
        stage_of("learning", n_learning, learn, tuple(feedback), tuple(learning)),
        stage_of("chop", None, after, tuple(final), tuple(frozen), shift),
    )
