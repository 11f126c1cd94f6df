"""Strategies by name: from a chop to the stages in which it is played. STRATEGIES is the only list.

A strategy sees the task and a design model; what it returns is data, as `campaigns.strategies.stages` describes it.
Other packages may add to the list (`sim_backend.plugins`).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sim_backend.errors import ConfigError, did_you_mean
from sim_backend.plugins import plugin_names

if TYPE_CHECKING:
    from campaigns.strategies.design import Design
    from campaigns.strategies.stages import Stage, Strategy, Task
    from campaigns.strategies.watch import Promise
    from sim_backend.control.blocks import DiscreteFilter

# Each name with the module beside this and the function in it: a name is checked without importing what plays it.
STRATEGIES: Final[Mapping[str, str]] = MappingProxyType(
    {
        "hybrid": "feedforward:hybrid_stages",
        "mbff": "feedforward:mbff_stages",
        "repetitive": "learned:repetitive_stages",
        "learned-hybrid": "learned:learned_hybrid_stages",
        "learned-mbff": "learned:learned_mbff_stages",
        "designed-linear": "designed:linear_stages",
        "designed-modes": "designed:modes_stages",
        "designed-hysteresis": "designed:hysteresis_stages",
        "designed": "designed:learned_stages",
    }
)


def check_strategy(name: str, controller: str | None) -> None:
    """Raise ConfigError for a name that is none, and for a designed strategy without a `controller` file to play."""
    if name not in STRATEGIES:
        known = (*STRATEGIES, *plugin_names("strategies", STRATEGIES))
        if name in known:
            return
        near = did_you_mean(name, known)
        raise ConfigError(f"there is no strategy '{name}'; {near}strategies: {', '.join(known)}")
    if STRATEGIES[name].startswith("designed:") and controller is None:
        raise ConfigError(
            "a designed strategy needs a controller file: write one with `mccd design`, give it as --controller"
        )


def _played_by(strategy: str) -> Strategy:
    """Return the function that plays a strategy, imported now."""
    if strategy not in STRATEGIES:
        from campaigns.strategies.plugin import stages_of_plugin

        return partial(stages_of_plugin, strategy)
    module, _, function = STRATEGIES[strategy].partition(":")
    own: Strategy = getattr(import_module(f"{__name__}.{module}"), function)
    return own


def promise_of(name: str, task: Task, design: Design) -> Promise:
    """Return what a strategy by name promises of a chop."""
    from campaigns.strategies.stages import move_samples, moving  # a name alone is checked without numpy
    from campaigns.strategies.watch import RINGING_S, Promise

    controls = [None if design.controller is None else design.controller.axis(dof) for dof in task.axes]
    axes = tuple(i for i, moves in enumerate(moving(task)) if moves)
    played, step = STRATEGIES.get(name, ""), move_samples(task, design)
    learned = played == "designed:learned_stages"
    knows = played.startswith(("feedforward:", "designed:"))  # what the others leave, they have not learned yet
    return Promise(
        moving=axes,
        shrinks_to=tuple(1.0 if (one := controls[i]) is None else one.shrinks_to for i in axes),
        held=tuple(i for i, one in enumerate(controls) if one is not None) if learned else axes if knows else (),
        step_samples=step if learned else max(step, round(RINGING_S * design.rate_hz)),
        feedback=_brings_back(task, design, axes),
    )


def _brings_back(task: Task, design: Design, moving: tuple[int, ...]) -> tuple[DiscreteFilter | None, ...] | None:
    """Return the paper's feedback of every axis, None where it would make one that moves unstable."""
    from campaigns.strategies.design import feedback_of

    feedback = tuple(feedback_of(dof, design.rate_hz) for dof in task.axes)
    try:
        for axis in moving:
            if (loop := feedback[axis]) is not None:
                design.require_stable(task.axes[axis], loop)
    except ConfigError:
        return None
    return feedback


def stages_of(strategy: str, task: Task, design: Design) -> tuple[Stage, ...]:
    """Return the stages of a strategy by name, one that `check_strategy` knows.

    Raises ConfigError for a controller whose loop is unstable on the design model, and for a strategy of another
    package that fails or returns no sound stages.
    """
    stages = _played_by(strategy)(task, design)
    loops = {(dof, id(loop)): loop for stage in stages for dof, loop in zip(task.axes, stage.feedback, strict=True)}
    for (dof, _), controller in loops.items():
        if controller is not None:
            design.require_stable(dof, controller)
    return stages
