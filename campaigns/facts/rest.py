"""Samples in which nothing happens: a segment at rest decides nothing, and zeros after the end are no measurement."""

from __future__ import annotations

import numpy as np

from campaigns.facts.base import Fact, Seen, by_segment, changed, runs_of

AT_REST = "at-rest"

LEAST_ROWS = 20
"""Samples at the end of a record in which nothing may change before it counts as having ended there."""


def facts(seen: Seen) -> list[Fact]:
    """Return segments in which an output is constant, and samples at the end in which all channels are."""
    found = []
    outputs = seen.of_role("output")
    for name, values in outputs.items():
        if np.ptp(values) == 0.0:
            continue  # dead throughout, which is a fact of its own
        for segment, part in by_segment(seen, values):
            if seen.complete and part.size > 1 and np.ptp(part) == 0.0:
                found.append(
                    Fact(
                        AT_REST,
                        f'{name} is {part[0]:.6g} in all of "{segment.label}", samples {segment.start} to '
                        f"{segment.stop}",
                        "the segment is left out; nothing can be held out or fitted there",
                        name,
                        segment.label,
                        {"start": segment.start, "stop": segment.stop},
                    )
                )
    rows = _still_rows(seen)
    if seen.complete and LEAST_ROWS <= rows < seen.rows and outputs:
        last = seen.rows - rows
        found.append(
            Fact(
                "ended",
                f"from sample {last} on, {rows} samples to the end, no input or output changes",
                "the recorder stopped or the bench was off: these samples are left out",
                numbers={"start": last, "stop": seen.rows},
            )
        )
    return found


def _still_rows(seen: Seen) -> int:
    """Return how many samples at the end hold the last values of all channels, none where it rests as long before."""
    moved = np.zeros(seen.rows - 1, dtype=bool)
    for values in seen.of_role("input", "output").values():
        moved |= changed(values)
    starts, stops = runs_of(~moved)
    if not starts.size or stops[-1] != moved.size:
        return 0
    lengths = stops - starts
    return int(lengths[-1]) + 1 if lengths.size == 1 or lengths[-1] > lengths[:-1].max() else 0
