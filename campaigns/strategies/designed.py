"""The designed strategies: what `mccd design` wrote, with as much of its knowledge as a strategy is named after.

The feedback is always closed, on a reference that the plant can follow, so that it only has to suppress noise. The
feed-forward for that reference knows, one after the other, the modes of the mechanism, those of the cryostat, and
magnetic hysteresis; what it does not know is learned, period by period, around the closed loop, and then frozen.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from campaigns.strategies.controller import AxisControl, Controller
from campaigns.strategies.design import Design, feedback_of
from campaigns.strategies.stages import Stage, Strategy, Task, chop_of, held, moving, stage_of
from sim_backend.along import torque_along
from sim_backend.bench import Gate, Learning
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.control.chop import AxisProgram, Chop
from sim_backend.control.concentrated import concentrated_move
from sim_backend.control.inversion import advanced, periodic_input
from sim_backend.control.repetitive import convergence, process_sensitivity, q_taps
from sim_backend.effects import Site, effect_class
from sim_backend.effects.base import Aux
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise
from sim_backend.model import EffectEntry, Model

Array = NDArray[np.float64]
Knowledge = Literal["linear", "modes", "hysteresis", "learned"]

STRONG = 0.1
"""A mode belongs to the mechanism when its response to torque is at least this part of the strongest one's: inertia and
mirror differ by 5 % from each other, the modes of the cryostat have up to 5 % of them."""

CONVERGENCE_LINES = 2000
"""Frequencies at which the convergence of a controller is checked before it is played, besides those of its modes."""

MAGNETISING_PERIODS = 3
"""Periods after which a path from the unmagnetised state has closed: the second already repeats the first's end."""


def _designed(knowledge: Knowledge) -> Strategy:
    """Return the strategy that knows everything in `Knowledge` up to and including `knowledge`."""

    def stages(task: Task, design: Design) -> tuple[Stage, ...]:
        assert design.controller is not None, "the plan has checked that there is one"
        return _stages(task, design, design.controller, knowledge)

    return stages


linear_stages = _designed("linear")
modes_stages = _designed("modes")
hysteresis_stages = _designed("hysteresis")
learned_stages = _designed("learned")


def motion_of(control: AxisControl, chop: Chop) -> Array:
    """Return one period (period,) of the reference; raises ConfigError when the move outlasts its dwell."""
    return move_over(chop, control.samples, control.concentration, control.dof)


def move_over(chop: Chop, samples: Callable[[float], int], concentration: float, dof: str) -> Array:
    """Return one period (period,) of moves that take `samples` of their distance; raises as `motion_of`."""
    out = np.empty(chop.period)
    for first, before, after in chop.moves():
        n = samples(after - before)
        if n >= chop.dwell_samples:
            raise ConfigError(
                f"axis '{dof}': its move of {n} samples outlasts the dwell of {chop.dwell_samples}; slow the chop down"
            )
        dwell = out[first : first + chop.dwell_samples]
        dwell[:] = after
        dwell[: n + 1] = before + (after - before) * concentrated_move(n, concentration)
    return out


def feedforward_of(design: Design, dof: str, motion: Array, knowledge: Knowledge) -> Array:
    """Return the periodic feed-forward (n,) with which the known plant follows one period `motion` (n,).

    Both are in the units of the input and the output of `dof`. "linear" inverts the modes of the mechanism, "modes" all
    of them; "hysteresis" and "learned" also oppose the torques of the structure's effects, as they are in the last of
    `MAGNETISING_PERIODS` periods. Raises ConfigError where the plant has no gain at a frequency of the motion.
    """
    plant = design.axis(dof)
    known = get_args(Knowledge).index(knowledge)
    drive = periodic_input(mechanism(plant) if known == 0 else plant, motion, design.rate_hz)
    if known < get_args(Knowledge).index("hysteresis"):
        return drive
    path = np.tile(motion, MAGNETISING_PERIODS)
    for entry in structural(design.model, dof):
        drive = drive - torque_along(entry, path, design.rate_hz)[-motion.size :]
    return drive


def structural(model: Model, dof: str) -> list[EffectEntry]:
    """Return the effects of a model whose torque follows from the motion of an axis alone."""
    kinds = [(entry, effect_class(entry.effect)) for entry in model.effects if entry.where == dof]
    return [entry for entry, kind in kinds if kind.site is Site.STRUCTURE and kind.aux is Aux.NONE]


def mechanism(plant: ModalModel) -> ModalModel:
    """Return a plant without its weak modes, those of what carries the mechanism."""
    size = np.abs(plant.b[:, 0] * plant.c[0])
    return plant.only(size >= STRONG * size.max())


def learning_of(control: AxisControl, period: int, rate_hz: float, gain: float) -> Learning:
    """Return the learning of an axis with one of its gains."""
    taps = q_taps(control.q_cutoff_hz, control.q_half_length, rate_hz)
    return Learning(control.learning.filter(rate_hz), gain, control.lead_samples, period, taps)


def _stages(task: Task, design: Design, controller: Controller, knowledge: Knowledge) -> tuple[Stage, ...]:
    moves, rate = moving(task), design.rate_hz
    controls = [controller.axis(dof) for dof in task.axes]
    missing = [dof for dof, one, moved in zip(task.axes, controls, moves, strict=True) if moved and one is None]
    if missing:
        raise ConfigError(f"controller '{controller.name}' has no axis '{missing[0]}', which the chop moves; design it")
    feedback = tuple(
        feedback_of(dof, rate) if one is None else one.feedback.filter(rate)
        for dof, one in zip(task.axes, controls, strict=True)
    )
    approach: list[AxisProgram] = []
    chopping: list[AxisProgram] = []
    for axis, (one, moved) in enumerate(zip(controls, moves, strict=True)):
        chop = chop_of(task, design, axis)
        first = Chop((chop.levels[1], 0.0), task.dwell_samples, rate)
        for into, what in ((approach, first), (chopping, chop)):
            into.append(_program(design, one, what, axis, knowledge) if moved and one else held(what, axis))
    stages = [stage_of("approach", task.dwell_samples, approach, feedback)]
    if knowledge == "learned":
        for one, moved, loop in zip(controls, moves, feedback, strict=True):
            if one is not None and moved and loop is not None:
                design.require_stable(one.dof, loop)  # an unstable loop has no convergence to speak of
                _require_convergence(design, one, loop)
        stages += _learning(
            task, chopping, feedback, [c if m else None for c, m in zip(controls, moves, strict=True)], rate
        )
    frozen = tuple(None if one is None else replace(one, active=False) for one in stages[-1].learning)
    return *stages, stage_of("chop", None, chopping, feedback, frozen)


def _require_convergence(design: Design, control: AxisControl, loop: DiscreteFilter) -> None:
    """Raise ConfigError where learning would diverge on the very model that comes with it."""
    rate, plant = design.rate_hz, discretise(design.axis(control.dof), design.rate_hz)
    modes_hz = design.axis(control.dof).omega_rad_s / (2.0 * np.pi)
    f = np.unique(np.concatenate([np.linspace(1.0, 0.499 * rate, CONVERGENCE_LINES), modes_hz]))
    f = f[(f >= 1.0) & (f < 0.5 * rate)]
    closed = process_sensitivity(plant.frequency_response(f)[:, 0, 0], loop.frequency_response(f))
    taps = q_taps(control.q_cutoff_hz, control.q_half_length, rate)
    left = convergence(f, closed, control.learning.filter(rate), max(control.gains), control.lead_samples, taps)
    worst = int(np.argmax(left))
    if not left[worst] < 1.0:
        raise ConfigError(
            f"axis '{control.dof}': a period would leave {left[worst]:.3g} of an error at {f[worst]:.4g} Hz on the "
            "controller's own model, the limit is 1: learning would diverge; design it anew"
        )


def _program(design: Design, control: AxisControl, chop: Chop, axis: int, knowledge: Knowledge) -> AxisProgram:
    motion = motion_of(control, chop)
    drive = feedforward_of(design, control.dof, motion, knowledge)
    if knowledge == "learned":
        drive = advanced(drive, control.late_samples)
    return AxisProgram(motion, drive, (Gate(0, axis, True, 0.0),))


def _learning(
    task: Task,
    programs: list[AxisProgram],
    feedback: tuple[DiscreteFilter | None, ...],
    learners: list[AxisControl | None],
    rate_hz: float,
) -> list[Stage]:
    """Wait until start and magnetisation are forgotten, then learn one period with each gain.

    Axes that move wait for and learn as long as the slowest; one whose gains are used up goes on with its last. The
    task's `learning_s` ends learning earlier.
    """
    active = [one for one in learners if one is not None]
    period_s = task.period / rate_hz
    wait = max(math.ceil(max(one.wait_s for one in active) / period_s - 1e-9), 1)
    count = max(len(one.gains) for one in active)
    if task.tuning.learning_s is not None:
        count = min(count, max(round(task.tuning.learning_s / period_s), 1))

    def learning(k: int) -> tuple[Learning | None, ...]:
        return tuple(
            None
            if one is None
            else learning_of(one, task.period, rate_hz, 0.0 if k < 0 else one.gains[min(k, len(one.gains) - 1)])
            for one in learners
        )

    # a gain of zero listens: each period learns from the errors of the one before it
    stages = [stage_of("settling in", wait * task.period, programs, feedback, learning(-1))]
    stages += [stage_of(f"learning {k + 1}", task.period, programs, feedback, learning(k)) for k in range(count)]
    return stages
