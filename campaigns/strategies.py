"""Strategies by name: from a chop to the stages in which it is played. STRATEGIES is the only list.

A strategy sees the task and a design model; what it returns is data. It begins at rest at zero. Every stage is a
period that repeats; the period starts with the move to position 2, so that a chop from zero starts from rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import msgspec
import numpy as np
from numpy.typing import NDArray

from campaigns.design import Design, feedback_of
from sim_backend.bench import Gate, Learning, Segment
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.control.chop import AxisProgram, Chop
from sim_backend.control.hybrid import hybrid
from sim_backend.control.mbff import mbff
from sim_backend.control.profile import MotionLimits
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]


LEARNING_S = {"theta_x": 10.0, "theta_y": 4.7}
"""How long an axis learns before its feedback closes, in s.

θy: printed (section 6.3.2). θx: assumed. At rest the error shrinks by 1 − k_r per period, so that with the printed
k_r = 0.1 the 23 periods of 4.7 s would leave 9 % of it; "after 10 seconds of chopping" (section 6.5) is the only
other time of learning in the paper.
"""


class Tuning(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What strategies leave free.

    `move_s` is the time of a transition: exactly that of the feed-forward, at most that of the learned reference
    (whose limits the paper does not print: the fourth-order profile that the derivative of jerk alone bounds).
    After `learning_s` (by default the longest LEARNING_S of the axes that move) a learned input is frozen, or, with
    `keeps_learning`, learned on, and the feedback closes with its gain times `feedback_factor`. `learning_modes` is how
    many modes L inverts: the printed one inverts one.
    """

    move_s: float = 0.005
    learning_s: float | None = None
    feedback_factor: float = 1.5
    learning_modes: int = 1
    keeps_learning: bool = False

    def __post_init__(self) -> None:
        for name in ("move_s", "learning_s", "feedback_factor", "learning_modes"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0):
                raise ConfigError(f"strategy: {name} is {value}; it must be a finite number above zero")


@dataclass(frozen=True)
class Task:
    """A chop of all axes between `position_1` and `position_2` (n_axes,), each held for `dwell_samples`."""

    axes: tuple[str, ...]
    position_1: Array
    position_2: Array
    dwell_samples: int
    tuning: Tuning

    @property
    def period(self) -> int:
        """Samples in one period."""
        return 2 * self.dwell_samples


@dataclass(frozen=True)
class Stage:
    """A period of waveforms and loops, played for `n_samples`, or to the end when that is None.

    `reference` and `feedforward` are (period, n_axes). The period begins `shift` samples after the move to position
    2, so that a stage can take over within a period.
    """

    label: str
    n_samples: int | None
    reference: Array
    feedforward: Array
    feedback: tuple[DiscreteFilter | None, ...]
    gates: tuple[Gate, ...]
    learning: tuple[Learning | None, ...] = ()
    shift: int = 0


Strategy = Callable[[Task, Design], tuple[Stage, ...]]
Program = Callable[[Chop, int], AxisProgram]


def hybrid_stages(task: Task, design: Design) -> tuple[Stage, ...]:
    """Feed-forward alone drives the move, then the feedback closes; section 6.3.1."""
    move = _move_samples(task, design)

    def program(chop: Chop, axis: int) -> AxisProgram:
        return hybrid(chop, design.unit_step(task.axes[axis], move), axis)

    return _approach_and_chop(task, design, program)


def mbff_stages(task: Task, design: Design) -> tuple[Stage, ...]:
    """Feed-forward added to a loop that stays closed; the conventional strategy."""
    move = _move_samples(task, design)

    def program(chop: Chop, axis: int) -> AxisProgram:
        dof = task.axes[axis]
        return mbff(chop, design.axis(dof), design.unit_step(dof, move), axis)

    return _approach_and_chop(task, design, program)


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
    arrival = _move_samples(task, design)

    def program(chop: Chop, axis: int) -> AxisProgram:
        starts = [first for first, _, _ in chop.moves()]
        gates = [g for s in starts for g in (Gate(s, axis, False), Gate(s + arrival, axis, True, 0.0))]
        return AxisProgram(chop.levels_held(), np.zeros(chop.period), tuple(gates))

    return _learn_then(task, design, program, 1.0)


STRATEGIES: dict[str, Strategy] = {
    "hybrid": hybrid_stages,
    "mbff": mbff_stages,
    "repetitive": repetitive_stages,
    "learned-hybrid": learned_hybrid_stages,
    "learned-mbff": learned_mbff_stages,
}


def stages_of(strategy: str, task: Task, design: Design) -> tuple[Stage, ...]:
    """Return the stages of a strategy by name.

    Raises ConfigError for a name that is none, and for a controller whose loop is unstable on the design model.
    """
    if strategy not in STRATEGIES:
        raise ConfigError(f"there is no strategy '{strategy}'; strategies: {', '.join(STRATEGIES)}")
    stages = STRATEGIES[strategy](task, design)
    for stage in stages:
        for dof, controller in zip(task.axes, stage.feedback, strict=True):
            if controller is not None:
                design.require_stable(dof, controller)
    return stages


def move_profile_limits(distance: float, move_s: float, rate_hz: float) -> MotionLimits:
    """Return limits under which a fourth-order move over `distance` takes at most `move_s`, only its snap being bound.

    Eight equal stretches of t whole samples: x = 8 d t⁴ (Lambrechts et al., 2005).
    """
    free = 1e30
    t_s = max(int(move_s * rate_hz / 8.0 + 1e-9), 1) / rate_hz
    return MotionLimits(free, free, free, abs(distance) / (8.0 * t_s**4) if distance else 1.0)


def stage_segments(
    task: Task,
    stage: Stage,
    n_samples: int,
    longest: int,
    record: tuple[str, ...],
    settings: dict[str, float | str],
) -> Iterator[Segment]:
    """Cut `n_samples` of a stage into segments of whole periods, each of about `longest` samples at most.

    Their settings say where in the period the moves to the two positions begin, so that analysis needs no guess.
    """
    whole = max(longest // task.period, 1) * task.period
    own: dict[str, float | str] = {
        "phase": stage.label,
        "period_samples": task.period,
        "dwell_samples": task.dwell_samples,
        "position_2_at": (-stage.shift) % task.period,
        "position_1_at": (task.dwell_samples - stage.shift) % task.period,
    }
    for first in range(0, n_samples, whole):
        count = min(whole, n_samples - first)
        yield Segment(
            label=stage.label if n_samples <= whole else f"{stage.label} {first // whole + 1}",
            n_samples=count,
            reference=stage.reference,
            feedforward=stage.feedforward,
            feedback=stage.feedback,
            gates=stage.gates,
            learning=stage.learning,
            record=record,
            settings={**own, "first_sample": first, **settings},
        )


def _move_samples(task: Task, design: Design) -> int:
    return max(round(task.tuning.move_s * design.rate_hz), 1)


def _chop(task: Task, design: Design, axis: int) -> Chop:
    levels = (float(task.position_2[axis]), float(task.position_1[axis]))
    return Chop(levels, task.dwell_samples, design.rate_hz)


def _held(chop: Chop, axis: int) -> AxisProgram:
    return AxisProgram(np.zeros(chop.period), np.zeros(chop.period), (Gate(0, axis, True, 0.0),))


def _moving(task: Task) -> list[bool]:
    return [bool(a or b) for a, b in zip(task.position_1, task.position_2, strict=True)]


def _stage(
    label: str,
    n_samples: int | None,
    programs: list[AxisProgram],
    feedback: tuple[DiscreteFilter | None, ...],
    learning: tuple[Learning | None, ...] = (),
    shift: int = 0,
) -> Stage:
    period = programs[0].reference.size
    gates = [
        Gate((g.at_sample - shift) % period, g.axis, g.closed, g.integrator)
        for program in programs
        for g in program.gates
    ]
    return Stage(
        label,
        n_samples,
        np.roll(np.stack([p.reference for p in programs], axis=1), -shift, axis=0),
        np.roll(np.stack([p.feedforward for p in programs], axis=1), -shift, axis=0),
        feedback,
        tuple(gates),
        learning,
        shift,
    )


def _approach_and_chop(task: Task, design: Design, program: Program) -> tuple[Stage, ...]:
    """One dwell to reach position 1 from zero, by the same strategy, then the chop."""
    feedback = tuple(feedback_of(dof, design.rate_hz) for dof in task.axes)
    approach, chop = [], []
    for axis, moves in enumerate(_moving(task)):
        there = _chop(task, design, axis)
        first = Chop((there.levels[1], 0.0), task.dwell_samples, design.rate_hz)
        approach.append(program(first, axis) if moves else _held(first, axis))
        chop.append(program(there, axis) if moves else _held(there, axis))
    return _stage("approach", task.dwell_samples, approach, feedback), _stage("chop", None, chop, feedback)


def _always_closed(task: Task) -> Program:
    def program(chop: Chop, axis: int) -> AxisProgram:
        return AxisProgram(_profile(task, chop), np.zeros(chop.period), (Gate(0, axis, True, 0.0),))

    return program


def _profile(task: Task, chop: Chop) -> Array:
    return chop.profile(move_profile_limits(chop.levels[0] - chop.levels[1], task.tuning.move_s, chop.rate_hz))


def _learn_then(task: Task, design: Design, program: Program, factor: float) -> tuple[Stage, ...]:
    tuning = task.tuning
    moving = [dof for dof, moves in zip(task.axes, _moving(task), strict=True) if moves]
    learning_s = tuning.learning_s or max(LEARNING_S.get(dof, 0.0) for dof in moving)
    n_learning = max(round(learning_s * design.rate_hz), 1)
    learn, after, learning, frozen, feedback, final = [], [], [], [], [], []
    for axis, (dof, moves) in enumerate(zip(task.axes, _moving(task), strict=True)):
        chop = _chop(task, design, axis)
        quiet = AxisProgram(_profile(task, chop), np.zeros(chop.period), (Gate(0, axis, False),))
        learn.append(quiet if moves else _held(chop, axis))
        after.append(program(chop, axis) if moves else _held(chop, axis))
        one = design.learning(dof, task.period, tuning.learning_modes) if moves else None
        learning.append(one)
        frozen.append(one if one is None else replace(one, active=tuning.keeps_learning))
        feedback.append(feedback_of(dof, design.rate_hz))
        final.append(feedback_of(dof, design.rate_hz, factor if moves else 1.0))
    shift = n_learning % task.period
    return (
        _stage("learning", n_learning, learn, tuple(feedback), tuple(learning)),
        _stage("chop", None, after, tuple(final), tuple(frozen), shift),
    )
