"""What is known of the records of an identification before anything is fitted."""

from __future__ import annotations

from collections.abc import Sequence

from campaigns.facts import remarks_on
from campaigns.log import Run


def is_stepped_sine(run: Run) -> bool:
    """Tell whether a log holds a stepped sine, whose steady state is measured."""
    return any("measure_from" in s.settings for s in run.segments)


def remarks_on_records(runs: Sequence[Run]) -> tuple[str, ...]:
    """Return the remarks on logs; on a stepped sine those that concern the axis that it drives.

    The other axes of a stepped sine are not used: at rest they are as they should be.
    """
    if not runs or not all(is_stepped_sine(run) for run in runs):
        return remarks_on(runs)
    told: list[str] = []
    for run in runs:
        axis = next((s.settings["axis"] for s in run.segments if "axis" in s.settings), None)
        told += remarks_on([run], [name for name, c in run.channels.items() if c.dof == axis])
    return tuple(dict.fromkeys(told))


def untold(_remark: str) -> None:
    """Hear a remark that is only returned with the result."""
