"""Samples in which a channel holds no number: a sensor or line did not deliver, as the serial protocol allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.base import Array, Fact, Seen, by_segment
from campaigns.log.read import Run
from campaigns.log.schema import LogSegment

NAME = "missing"

ROWS_AT_ONCE = 65536
"""Samples of a log that are read together."""

ROLES = ("input", "output", "reference")


def facts(seen: Seen) -> list[Fact]:
    """Return the channels that hold no number in some samples, by segment."""
    return [
        Fact(
            NAME,
            f'{name} holds no number in {bad.size} of {segment.rows} samples of "{segment.label}", first '
            f"in sample {segment.start + int(bad[0])}",
            "such samples are no measurement and are left out of every fit of mccd identify; mccd diagnose refuses "
            "them",
            name,
            segment.label,
            {"rows": int(bad.size), "first": segment.start + int(bad[0])},
        )
        for name, values in seen.of_role(*ROLES).items()
        for segment, part in by_segment(seen, values)
        if (bad := np.flatnonzero(~np.isfinite(part))).size
    ]


def missing_rows(run: Run, segment: LogSegment) -> NDArray[np.bool_]:
    """Return in which samples (n,) of a segment an input, output or reference holds no number; it is read in blocks."""
    names = [name for role in ROLES for name in run.names(role)]
    missing = np.zeros(segment.rows, dtype=bool)
    for first, block in run.blocks(names, segment.start, segment.stop, ROWS_AT_ONCE):
        for values in block.values():
            missing[first - segment.start : first - segment.start + values.size] |= ~np.isfinite(values)
    return missing


def drawn_over(seen: Seen) -> Seen:
    """Return a record with straight lines over what holds no number, for facts that need its other samples.

    A channel that holds none at all is left out: it has no size and is not constant.
    """
    columns = {name: _drawn(values) for name, values in seen.columns.items() if np.isfinite(values).any()}
    return replace(seen, columns=columns)


def _drawn(values: Array) -> Array:
    good = np.isfinite(values)
    if good.all():
        return values
    rows = np.arange(values.size)
    return np.interp(rows, rows[good], values[good])
