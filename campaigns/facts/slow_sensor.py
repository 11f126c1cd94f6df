"""Readings that repeat the one before exactly: a sensor slower than the logger, or samples lost on the way."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.base import Array, Fact, Seen, changed
from campaigns.facts.steps import step_of

MOST_ROWS = 1000
"""Slowest sensor that is searched for, in samples of the log."""

LEAST_CHANGES = 20
ON_BEAT = 0.98
"""Part of the changes that fall on the beat of a slow sensor."""

REPEATED = 0.02
"""Part of the readings that repeat the one before before that is reported."""


AT_ONCE = 1_000_000
"""Changes that are counted together: memory does not grow with their number."""


def facts(seen: Seen) -> list[Fact]:
    """Return the outputs that repeat their readings, and after how many samples a new one comes."""
    found = []
    for name, values in seen.of_role("output").items():
        at = _rows_of_changes(values)
        if at.size < LEAST_CHANGES:
            continue
        every, last = beat(at), int(at[-1])
        del at  # of a long record each row of numbers counts
        if every > 1 and not _driven_so(seen, every):
            found.append(
                Fact(
                    "slow-sensor",
                    f"{name} changes at every {_ordinal(every)} sample only, {seen.rate_hz / every:g} Hz",
                    "the sensor is slower than the log: what is said holds below half its rate only, and images of the "
                    "staircase above are no resonances; import every such sample instead",
                    name,
                    numbers={"every": every, "offset": last % every},
                )
            )
            continue
        # what stands still to the end, or at the end of the sensor's range, has a fact of its own
        at_end = np.isin(values[1 : last + 1], (values.min(), values.max()))
        share = float(np.mean(~changed(values[: last + 1]) & ~at_end))
        if share > REPEATED and not _is_coarse(values):
            found.append(
                Fact(
                    "repeated",
                    f"{100.0 * share:.1f} % of the readings of {name} repeat the one before exactly",
                    "samples were lost on the way to the log, or it rests for so long",
                    name,
                    numbers={"share": share},
                )
            )
    return found


def _driven_so(seen: Seen, every: int) -> bool:
    """Tell whether what is driven in steps may answer in the same ones; between longer ones it would move."""
    for values in seen.of_role("input", "reference").values():
        at = _rows_of_changes(values)
        if at.size >= LEAST_CHANGES and beat(at) == every:
            return True
    return False


def _rows_of_changes(values: Array) -> NDArray[np.intp]:
    at = np.flatnonzero(changed(values))
    at += 1
    return at


def _is_coarse(values: Array) -> bool:
    """Tell whether the quantisation step of a column exceeds a fifth of its rms change per sample."""
    change = np.diff(values)
    change *= change
    return bool(step_of(values) > 0.2 * float(np.sqrt(np.mean(change))))


def beat(at: NDArray[np.intp]) -> int:
    """Return the longest period in samples at whose multiples nearly all changes `at` (n,) occur; 1 if none does."""
    starts = range(0, at.size, AT_ONCE)
    gaps = np.zeros(MOST_ROWS + 1, dtype=np.intp)
    for first in starts:
        gap = np.diff(at[first : first + AT_ONCE + 1])
        gaps += np.bincount(np.minimum(gap, MOST_ROWS), minlength=gaps.size)
    usual = int(gaps.argmax())
    for every in (d for d in range(usual, 1, -1) if usual % d == 0):  # a beat divides the gap that is most frequent
        on = sum(np.bincount(at[first : first + AT_ONCE] % every, minlength=every) for first in starts)
        if np.max(on) >= ON_BEAT * at.size:
            return every
    return 1


def _ordinal(number: int) -> str:
    ends = {1: "st", 2: "nd", 3: "rd"}
    return f"{number}{'th' if number % 100 in (11, 12, 13) else ends.get(number % 10, 'th')}"
