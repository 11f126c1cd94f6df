"""Strategies by name: from a chop to the stages in which it is played. STRATEGIES is the only list.

A strategy sees the task and a design model; what it returns is data, as `campaigns.strategies.stages` describes it.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from sim_backend.errors import ConfigError, did_you_mean

if TYPE_CHECKING:
    from campaigns.strategies.design import Design
    from campaigns.strategies.stages import Stage, Strategy, Task

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
        near = did_you_mean(name, STRATEGIES)
        raise ConfigError(f"there is no strategy '{name}'; {near}strategies: {', '.join(STRATEGIES)}")
    if STRATEGIES[name].startswith("designed:") and controller is None:
        raise ConfigError(
            "a designed strategy needs a controller file: write one with `mccd design`, give it as --controller"
        )


def stages_of(strategy: str, task: Task, design: Design) -> tuple[Stage, ...]:
    """Return the stages of a strategy by name, one of STRATEGIES.

    Raises ConfigError for a controller whose loop is unstable on the design model.
    """
    module, _, function = STRATEGIES[strategy].partition(":")
    play: Strategy = getattr(import_module(f"{__name__}.{module}"), function)
    stages = play(task, design)
    loops = {(dof, id(loop)): loop for stage in stages for dof, loop in zip(task.axes, stage.feedback, strict=True)}
    for (dof, _), controller in loops.items():
        if controller is not None:
            design.require_stable(dof, controller)
    return stages
