"""The steps in which a channel counts: digits of a text, a converter, an encoder."""

from __future__ import annotations

import numpy as np

from campaigns.facts.base import Array, Fact, Seen

LARGE = 0.01
"""Step against rms from which on counts are reported: its noise is then a third of a percent."""

MOST_VALUES = 200_000
ON_GRID = 0.98
GRID = 0.02


def facts(seen: Seen) -> list[Fact]:
    """Return the step of every output that counts in steps."""
    found = []
    for name, values in seen.of_role("output", "input").items():
        step = step_of(values)
        rms = float(values.std())
        if step <= 0.0 or rms == 0.0:
            continue
        unit, share = seen.channels[name].unit, step / rms
        large = share > LARGE and seen.channels[name].role == "output"
        found.append(
            Fact(
                "steps",
                f"{name} counts in steps of {step:.4g} {unit}, {share:.2g} of its rms",
                "rounding is part of its noise" if large else "",
                name,
                numbers={"step": step, "share": share},
                remark=large,
            )
        )
    return found


def step_of(values: Array) -> float:
    """Return the step of which all values (n,) are multiples but for an offset, 0 where they are of none.

    Values that were written with so many digits count in steps as well.
    """
    different = np.unique(values[:MOST_VALUES])
    if different.size < 3:
        return 0.0
    gaps = np.diff(different)
    least = float(gaps[gaps > 1e-9 * (different[-1] - different[0])].min(initial=np.inf))
    if not np.isfinite(least):
        return 0.0
    # the smallest gap carries the rounding of two numbers: its mean over the gaps of that size is better known
    small = gaps[(gaps > 0.5 * least) & (gaps < 1.5 * least)]
    step = float(small.mean())
    places = (different - different[0]) / step
    if places[-1] > 1e9:
        return 0.0
    on = np.abs(gaps / step - np.rint(gaps / step)) < GRID
    return step if float(on.mean()) >= ON_GRID else 0.0
