"""Strategies of other packages: what they return is checked to be a stage before it is used."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from campaigns.strategies.stages import Stage, Task
from sim_backend.bench import Gate, Learning
from sim_backend.control.blocks import DiscreteFilter
from sim_backend.errors import MccdError
from sim_backend.plugins import load_plugin, refusal

if TYPE_CHECKING:
    from campaigns.strategies.design import Design

GROUP = "strategies"


def stages_of_plugin(strategy: str, task: Task, design: Design) -> tuple[Stage, ...]:
    """Return the stages of a strategy that another package declares.

    Raises ConfigError naming the package for what is not a function, fails or returns no list of sound stages; an error
    of ours that the function raises stays as it is.
    """
    play = load_plugin(GROUP, strategy)
    if not callable(play):
        raise refusal(GROUP, strategy, "is not a function of a task and a design")
    try:
        found = play(task, design)
        stages = tuple(found) if not isinstance(found, Stage) else found
    except MccdError:
        raise
    except (Exception, SystemExit) as error:  # the code of others fails in any way
        reason = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise refusal(GROUP, strategy, f"fails as a function of a task and a design ({reason})") from None
    if not (isinstance(stages, tuple) and stages and all(isinstance(one, Stage) for one in stages)):
        raise refusal(GROUP, strategy, f"returns {type(found).__name__}, no list of stages")
    for stage in stages:
        if fault := _fault(stage, len(task.axes)):
            raise refusal(GROUP, strategy, f"returns a stage {str(stage.label)[:40]!r} whose {fault}")
    return stages


def _fault(stage: Stage, n_axes: int) -> str:
    """Say which part of a stage is not what it has to be, and what that is; nothing for a sound one."""
    if not isinstance(stage.label, str):
        return "label is not text"
    if stage.n_samples is not None and not (_is_whole(stage.n_samples) and stage.n_samples > 0):
        return f"n_samples is {stage.n_samples!r}: a number of samples, or None for all that remain"
    if not _is_whole(stage.shift):
        return f"shift is {stage.shift!r}: a number of samples"
    for name in ("reference", "feedforward"):
        values = getattr(stage, name)
        if not (isinstance(values, np.ndarray) and values.ndim == 2 and values.shape[1] == n_axes):
            return f"{name} is not an array of one column for each of the {n_axes} axes"
        if values.dtype.kind not in "fiu":
            return f"{name} is not an array of real numbers"
    if not (_all_of(stage.gates, Gate, None) and all(gate.axis in range(n_axes) for gate in stage.gates)):
        return f"gates are no list of gates of the {n_axes} axes"
    if not _all_of(stage.feedback, DiscreteFilter, n_axes):
        return f"feedback has not one filter or None for each of the {n_axes} axes"
    if not (_all_of(stage.learning, Learning, n_axes) or _all_of(stage.learning, Learning, 0)):
        return f"learning has not one entry or None for each of the {n_axes} axes"
    return ""


def _is_whole(value: Any) -> bool:
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def _all_of(values: Any, kind: type, count: int | None) -> bool:
    """Tell whether these are `count` of a kind or, where every axis has one, None; any number of them for no count."""
    if not isinstance(values, Sequence) or isinstance(values, str):
        return False
    absent = count is not None
    return count in (None, len(values)) and all(isinstance(one, kind) or (absent and one is None) for one in values)
