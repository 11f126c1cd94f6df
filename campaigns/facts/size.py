"""How large a channel is: a wrong unit is seen by its numbers."""

from __future__ import annotations

import math

import numpy as np

from campaigns.facts.base import Fact, Seen

LARGEST_ANGLE_RAD = math.pi
"""No reading of a mirror or an arm spans more than half a turn without being wrapped or in another unit."""


def facts(seen: Seen) -> list[Fact]:
    """Return smallest, largest and rms of every channel, with a remark on angles that are hardly in radians."""
    found = []
    for name, values in seen.columns.items():
        low, high = float(values.min()), float(values.max())
        about = values - values.mean()
        about *= about
        rms = float(np.sqrt(np.mean(about)))
        unit = seen.channels[name].unit
        numbers = {"smallest": low, "largest": high, "rms": rms}
        text = f"{low:.4g} to {high:.4g} {unit}, rms about the mean {rms:.4g}"
        wide = unit == "rad" and high - low > LARGEST_ANGLE_RAD
        means = "an angle of more than half a turn: was the unit degrees, arcseconds or µrad?" if wide else ""
        found.append(Fact("size", text, means, name, numbers=numbers, remark=wide))
    return found
