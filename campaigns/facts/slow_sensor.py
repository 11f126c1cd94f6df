"""Readings that repeat the one before exactly: a sensor slower than the logger, or samples lost on the way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.base import Fact, Seen
from campaigns.facts.steps import step_of

MOST_ROWS = 1000
"""Slowest sensor that is looked for, in rows of the log."""

LEAST_CHANGES = 20
ON_BEAT = 0.98
"""Part of the changes that fall on the beat of a slow sensor."""

REPEATED = 0.02
"""Part of the readings that repeat the one before before that is told."""


def facts(seen: Seen) -> list[Fact]:
    """Return the outputs that repeat their readings, and after how many rows a new one comes."""
    found = []
    # what is driven in steps may answer in the same steps; between steps that are longer it would move
    played = [np.flatnonzero(np.diff(values) != 0.0) + 1 for values in seen.of_role("input", "reference").values()]
    for name, values in seen.of_role("output").items():
        changed = np.flatnonzero(np.diff(values) != 0.0) + 1
        if changed.size < LEAST_CHANGES:
            continue
        every = beat(changed)
        if every > 1 and not any(beat(steps) == every for steps in played if steps.size >= LEAST_CHANGES):
            found.append(
                Fact(
                    "slow-sensor",
                    f"{name} changes at every {_ordinal(every)} row only, {seen.rate_hz / every:g} Hz",
                    "the sensor is slower than the log: what is said holds below half its rate only, and images of the "
                    "staircase above are no resonances; import every such row instead",
                    name,
                    numbers={"every": every, "offset": int(changed[-1] % every)},
                )
            )
            continue
        # what stands still to the end, or at the end of the sensor's range, has a fact of its own
        repeated = np.diff(values[: changed[-1] + 1]) == 0.0
        at_end = np.isin(values[1 : changed[-1] + 1], (values.min(), values.max()))
        share = float(np.mean(repeated & ~at_end))
        coarse = step_of(values) > 0.2 * float(np.sqrt(np.mean(np.diff(values) ** 2)))
        if share > REPEATED and not coarse:
            found.append(
                Fact(
                    "repeated",
                    f"{share:.1%} of the readings of {name} repeat the one before exactly",
                    "samples were lost on the way to the log, or it rests for so long",
                    name,
                    numbers={"share": share},
                )
            )
    return found


def beat(changed: NDArray[np.intp]) -> int:
    """Return the largest number of rows of which nearly all changes, at rows (n,), fall on one, 1 if there is none."""
    gaps = np.diff(changed)
    usual = int(np.bincount(np.minimum(gaps, MOST_ROWS)).argmax())  # a beat divides the gap that is most frequent
    for every in (d for d in range(usual, 1, -1) if usual % d == 0):
        if np.bincount(changed % every).max() >= ON_BEAT * changed.size:
            return every
    return 1


def _ordinal(number: int) -> str:
    ends = {1: "st", 2: "nd", 3: "rd"}
    return f"{number}{'th' if number % 100 in (11, 12, 13) else ends.get(number % 10, 'th')}"
