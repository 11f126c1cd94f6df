"""Strategies by name: from a chop to the stages in which it is played. STRATEGIES is the only list.

A strategy sees the task and a design model; what it returns is data, as `campaigns.strategies.stages` describes it.
"""

from __future__ import annotations

from campaigns.strategies.design import Design
from campaigns.strategies.designed import designed
from campaigns.strategies.feedforward import hybrid_stages, mbff_stages
from campaigns.strategies.learned import learned_hybrid_stages, learned_mbff_stages, repetitive_stages
from campaigns.strategies.stages import Stage, Strategy, Task
from sim_backend.errors import ConfigError, did_you_mean

STRATEGIES: dict[str, Strategy] = {
    "hybrid": hybrid_stages,
    "mbff": mbff_stages,
    "repetitive": repetitive_stages,
    "learned-hybrid": learned_hybrid_stages,
    "learned-mbff": learned_mbff_stages,
    "designed-linear": designed("linear"),
    "designed-modes": designed("modes"),
    "designed-hysteresis": designed("hysteresis"),
    "designed": designed("learned"),
}


def stages_of(strategy: str, task: Task, design: Design) -> tuple[Stage, ...]:
    """Return the stages of a strategy by name.

    Raises ConfigError for a name that is none, and for a controller whose loop is unstable on the design model.
    """
    if strategy not in STRATEGIES:
        near = did_you_mean(strategy, STRATEGIES)
        raise ConfigError(f"there is no strategy '{strategy}'; {near}strategies: {', '.join(STRATEGIES)}")
    stages = STRATEGIES[strategy](task, design)
    loops = {(dof, id(loop)): loop for stage in stages for dof, loop in zip(task.axes, stage.feedback, strict=True)}
    for (dof, _), controller in loops.items():
        if controller is not None:
            design.require_stable(dof, controller)
    return stages
