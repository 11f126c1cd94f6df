"""What every strategy is made of: a task, stages of it, and stages as segments. Data only; strategies fill it.

A strategy begins at rest at zero. Every stage is a period that repeats; the period starts with the move to position 2,
so that a chop from zero starts from rest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from numpy.typing import NDArray

from campaigns.sizes import samples_of_wave
from sim_backend.bench import Gate, Learning, Segment
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.control.chop import AxisProgram, Chop
from sim_backend.errors import ConfigError

if TYPE_CHECKING:
    from campaigns.strategies.design import Design

Array = NDArray[np.float64]


class Tuning(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What strategies leave free.

    `move_s` is the time of a transition: exactly that of the feed-forward, at most that of the learned reference
    (whose limits the paper does not print: the fourth-order profile that the derivative of jerk alone bounds).
    After `learning_s` (by default the longest LEARNING_S of the axes that move, or what a controller file says) a
    learned input is frozen, or, with `keeps_learning`, learned on, and the feedback closes with its gain times
    `feedback_factor`. `learning_modes` is how many modes L inverts: the printed one inverts one.
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


def learns(learning: Sequence[Learning | None]) -> bool:
    """Tell whether an input is being learned, or listened to first: what is heard now acts in the next period."""
    return any(one is not None and one.active for one in learning)


Strategy = Callable[[Task, "Design"], tuple[Stage, ...]]
Program = Callable[[Chop, int], AxisProgram]


def stage_segments(
    task: Task,
    stage: Stage,
    n_samples: int,
    longest: int,
    record: tuple[str, ...],
    settings: dict[str, float | str],
    first: int | None = None,
) -> Iterator[Segment]:
    """Cut `n_samples` of a stage into segments of whole periods, each of about `longest` samples at most.

    The first has about `first` at most. Their settings say where in the period the moves to the two positions begin, so
    that analysis needs no guess.
    """
    whole, opening = (max(n // task.period, 1) * task.period for n in (longest, longest if first is None else first))
    own: dict[str, float | str] = {
        "phase": stage.label,
        "period_samples": task.period,
        "dwell_samples": task.dwell_samples,
        "position_2_at": (-stage.shift) % task.period,
        "position_1_at": (task.dwell_samples - stage.shift) % task.period,
    }
    for number, start in enumerate(chain((0,), range(opening, n_samples, whole)), start=1):
        count = min(whole if start else opening, n_samples - start)
        yield Segment(
            label=stage.label if n_samples <= opening else f"{stage.label} {number}",
            n_samples=count,
            reference=stage.reference,
            feedforward=stage.feedforward,
            feedback=stage.feedback,
            gates=stage.gates,
            learning=stage.learning,
            record=record,
            settings={**own, "first_sample": start, **settings},
        )


def chop_of(task: Task, design: Design, axis: int) -> Chop:
    """Return the chop of one axis, beginning with the move to position 2."""
    levels = (float(task.position_2[axis]), float(task.position_1[axis]))
    return Chop(levels, task.dwell_samples, design.rate_hz)


def held(chop: Chop, axis: int) -> AxisProgram:
    """Return the reference of an axis that stays at zero."""
    return AxisProgram(np.zeros(chop.period), np.zeros(chop.period), (Gate(0, axis, True, 0.0),))


def moving(task: Task) -> list[bool]:
    """Return which axes leave zero."""
    return [bool(a or b) for a, b in zip(task.position_1, task.position_2, strict=True)]


def stage_of(
    label: str,
    n_samples: int | None,
    programs: list[AxisProgram],
    feedback: tuple[DiscreteFilter | None, ...],
    learning: tuple[Learning | None, ...] = (),
    shift: int = 0,
) -> Stage:
    """Return the stage that plays one program per axis, its period cut `shift` samples after the move."""
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


def move_samples(task: Task, design: Design) -> int:
    """Return the samples in which a move is made, one at least."""
    return samples_of_wave(task.tuning.move_s, design.rate_hz)
