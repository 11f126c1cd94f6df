"""How large a channel is: a wrong unit is seen by its numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from campaigns.facts.base import Array, Fact, Seen
from campaigns.facts.plausible import doubts

NAME = "size"

AT_ONCE = 1_000_000
"""Samples whose squares are summed together: a second copy of a long channel takes much memory."""


@dataclass(frozen=True)
class Size:
    """Smallest and largest value of a channel, and its rms about the mean, in the channel's unit."""

    smallest: float
    largest: float
    rms: float


def size_of(values: Array) -> Size | None:
    """Return the size of a channel (n,), of the samples that hold a number; None where none does."""
    held = np.isfinite(values)
    values = values if held.all() else values[held]
    if not values.size:
        return None
    mean = values.mean()
    squares = sum(
        float(about @ about) for about in (values[k : k + AT_ONCE] - mean for k in range(0, values.size, AT_ONCE))
    )
    return Size(float(values.min()), float(values.max()), math.sqrt(squares / values.size))


def facts(seen: Seen) -> list[Fact]:
    """Return the size of every channel, with a remark on one that is implausible in its unit."""
    sizes = {name: size for name, values in seen.columns.items() if (size := size_of(values)) is not None}
    doubted = doubts(seen, {name: (size.smallest, size.largest) for name, size in sizes.items()})
    found = []
    for name, size in sizes.items():
        unit = seen.channels[name].unit
        text = f"{name}: {size.smallest:.4g} to {size.largest:.4g} {unit}, rms about the mean {size.rms:.4g}"
        numbers = {"smallest": size.smallest, "largest": size.largest, "rms": size.rms}
        found.append(Fact(NAME, text, doubted.get(name, ""), name, numbers=numbers, remark=name in doubted))
    return found
