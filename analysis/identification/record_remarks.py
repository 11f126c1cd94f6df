"""What is known of the records of an identification before anything is fitted."""

from __future__ import annotations

from collections.abc import Sequence

from campaigns.facts import dead_in_all, facts_of, remarks_on
from campaigns.log import Run
from sim_backend.errors import DataError


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


def inputs_at_rest(runs: Sequence[Run]) -> tuple[str, ...]:
    """Return remarks on inputs that move in no log; raises DataError for an output that changes in none."""
    still = dead_in_all([facts_of(run) for run in runs])
    for fact in still:
        if fact.channel in runs[0].names("output"):
            raise DataError(f"{runs[0].path}: {fact.told}")
    names = [fact.channel for fact in still]
    if not names:
        return ()
    if len(names) == len(runs[0].names("input")):
        told = "no input moves in any log: gains are unknown, and modes are those of a free motion, if there was one"
    else:
        what = f"input {names[0]} moves" if len(names) == 1 else f"inputs {', '.join(names)} move"
        told = f"{what} in no log: gains from there are unknown, and written as zero"
    return (told,)


def untold(_remark: str) -> None:
    """Hear a remark that is only returned with the result."""
