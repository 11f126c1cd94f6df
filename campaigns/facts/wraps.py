"""Readings that begin anew: an angle after a turn, a counter after its last number."""

from __future__ import annotations

import numpy as np

from campaigns.facts.base import Fact, Seen

OF_RANGE = 0.6
"""A jump over so much of a channel's range, where all other steps are small, is not motion."""

SMALL = 0.1


def facts(seen: Seen) -> list[Fact]:
    """Return the outputs that jump over nearly their whole range from one sample to the next."""
    found = []
    for name, values in seen.of_role("output").items():
        steps = np.diff(values)
        np.abs(steps, out=steps)
        span = float(np.ptp(values))
        if span == 0.0 or steps.size < 10:
            continue
        jumps = np.flatnonzero(steps > OF_RANGE * span)
        tall = steps[jumps]
        steps[jumps] = 0.0  # the largest of the others is searched for
        if 0 < jumps.size < 0.2 * steps.size and float(steps.max()) < SMALL * span:
            unit = seen.channels[name].unit
            found.append(
                Fact(
                    "wraps",
                    f"{name} jumps by {tall[0]:.6g} {unit} at {jumps.size} sample(s), the first {jumps[0] + 1}",
                    "if it is an angle or a counter that begins anew, say unwrap = the jump in the source's unit",
                    name,
                    numbers={"jump": float(tall[0]), "count": int(jumps.size)},
                )
            )
    return found
