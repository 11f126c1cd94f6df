"""Channels that never change: an input that drives nothing, an output whose sensor or line is dead."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from campaigns.facts.base import Fact, Seen

NAME = "dead"


def facts(seen: Seen) -> list[Fact]:
    """Return the inputs and outputs that have one value throughout, none of a record that is not seen to its end.

    A record in which no output changes is forbidden. An input at rest is not a fault: another record may drive it.
    """
    if not seen.complete or seen.rows < 2:
        return []
    columns = seen.of_role("input", "output")
    still = {name: values for name, values in columns.items() if np.ptp(values) == 0.0}
    outputs = {name for name in columns if seen.channels[name].role == "output"}
    nothing = outputs <= still.keys()
    found = []
    for name, values in still.items():
        output = name in outputs
        found.append(
            Fact(
                NAME,
                f"{seen.channels[name].role} '{name}' is constant at {values[0]:.6g} {seen.channels[name].unit} in all "
                f"{values.size} samples",
                _means(output, nothing),
                name,
                numbers={"value": float(values[0])},
                forbids=output and nothing,
                remark=output,
            )
        )
    return found


def _means(output: bool, nothing: bool) -> str:
    if not output:
        return "its effect is unknown from this log: identify and diagnose say so if no other log moves it"
    if nothing:
        return "no output changes: identify and diagnose refuse the log; mend the sensors or select other channels"
    return (
        "a dead sensor or line: identify refuses it unless it changes in another log, diagnose refuses it if the model "
        "has this output; mend it, or leave the channel out"
    )


def dead_in_all(facts: Sequence[Sequence[Fact]]) -> tuple[Fact, ...]:
    """Return of the facts of each of several logs those on channels that are dead in every log, from the first log."""
    each = [{fact.channel: fact for fact in some if fact.name == NAME} for some in facts]
    return tuple(fact for name, fact in each[0].items() if all(name in other for other in each)) if each else ()
