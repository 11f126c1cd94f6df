"""A recorded hysteresis test: loops of slow sines, and fed-forward steps at offsets."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.measurements.loops import Loop, loop
from campaigns.log import Run
from sim_backend.errors import DataError

Array = NDArray[np.float64]

BEFORE_S = 0.01
"""How much of the rest before a step is shown."""


@dataclass(frozen=True)
class OffsetStep:
    """The step from `offset_rad` by `step_rad`: `time_s` (n,) from the start of the move, `moved_rad` (n,) since then.

    `command_nm` (n,) is what was played; `start_rad` where the mechanism stood before. Both angles are means over
    `repeats` steps.
    """

    offset_rad: float
    step_rad: float
    start_rad: float
    time_s: Array
    moved_rad: Array
    command_nm: Array
    repeats: int = 1


def axis_of(run: Run) -> str:
    """Return the axis of a hysteresis test; raises DataError for another log."""
    for segment in run.segments:
        if segment.settings.get("phase") in ("loop", "step"):
            return str(segment.settings["axis"])
    raise DataError(f"{run.path} holds neither loops nor steps: it is a log of '{run.header.test}'")


def loops_of(run: Run, lag_s: float = 0.0) -> dict[float, Loop]:
    """Return the loops by their torque amplitude (N m), the first cycle of each left out; Fig. 6.7.

    `lag_s` is the linear plant's lag at low frequency (see `measurements/loops.py`). Raises DataError for another log.
    """
    axis, loops = axis_of(run), {}
    for segment in run.segments:
        if segment.settings.get("phase") == "loop":
            period = int(segment.settings["period_samples"])
            # the first cycle starts from another history: only a single one is used as it is
            start = segment.start + (period if segment.rows >= 2 * period else 0)
            torque = run.read(command_of(run, axis), start, segment.stop)
            angle = run.read(axis, start, segment.stop)
            amplitude = float(segment.settings["amplitude"])
            loops[amplitude] = loop(torque, angle, period, lag_s, run.sample_rate_hz)
    return loops


def steps_of(run: Run) -> list[OffsetStep]:
    """Return the steps by their offset, in the order of the run, repeated ones averaged; Fig. 6.9.

    Raises DataError for another log.
    """
    axis, steps = axis_of(run), list[OffsetStep]()
    before = round(BEFORE_S * run.sample_rate_hz)
    for segment in run.segments:
        if segment.settings.get("phase") == "step":
            first = max(segment.start - before, 0)
            angle = run.read(axis, first, segment.stop)
            rest = float(angle[: segment.start - first].mean()) if segment.start > first else float(angle[0])
            steps.append(
                OffsetStep(
                    float(segment.settings["offset_rad"]),
                    float(segment.settings["step_rad"]),
                    rest,
                    (np.arange(angle.size) - (segment.start - first)) / run.sample_rate_hz,
                    angle - rest,
                    run.read(command_of(run, axis), first, segment.stop),
                )
            )
    return averaged_steps(steps)


def averaged_steps(steps: list[OffsetStep]) -> list[OffsetStep]:
    """Return one step per offset, the mean of those from it."""
    groups: dict[float, list[OffsetStep]] = {}
    for step in steps:
        groups.setdefault(step.offset_rad, []).append(step)
    return [
        replace(
            group[0],
            start_rad=float(np.mean([step.start_rad for step in group])),
            moved_rad=np.mean([step.moved_rad for step in group], axis=0),
            repeats=len(group),
        )
        for group in groups.values()
    ]


def command_of(run: Run, axis: str) -> str:
    """Return the input that drives an axis; raises DataError for a log without it."""
    found = [n for n in run.names("input") if run.channels[n].dof == axis]
    if not found:
        raise DataError(f"{run.path} holds no input that drives '{axis}'; record the command with the angle")
    return found[0]
