"""What no fit sees when nobody said so: the last segments that differ from the rest, else the last fifth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.records.dataset import Record, Window
from sim_backend.errors import DataError
from sim_backend.linear import Array

WANTED_SHARE = 0.2
"""Share of the samples that is held out when the choice is free."""

LARGEST_SHARE = 1.0 / 3.0
SMALLEST_SHARE = 0.05

SAME_SIZE = 1.1
"""Ratio of rms values up to which two inputs count as of one amplitude."""

SAME_WAVE = 0.95
"""Correlation above which two inputs count as one waveform."""

COMPARED_ROWS = 20_000


@dataclass(frozen=True)
class _Place:
    record: int
    window: int
    rows: int
    u: Array


def with_held_out(records: Sequence[Record]) -> tuple[tuple[Record, ...], str | None]:
    """Return the records with something held out, and a note on what was chosen; None when it was given.

    Raises DataError when every window is held out already, so that nothing can be fitted.
    """
    windows = [w for r in records for w in r.windows]
    if any(w.held_out for w in windows):
        if all(w.held_out for w in windows):
            raise DataError(
                f"all {len(windows)} segments are held out, so that nothing can be fitted; "
                "give a run of which some segment's label does not contain 'held-out'"
            )
        return tuple(records), None
    chosen = _last_that_differ(records)
    if chosen:
        names = ", ".join(f"'{records[p.record].windows[p.window].label}'" for p in reversed(chosen))
        note = f"no segment was held out; kept from every fit for judging: {names}, which differ from the rest"
        return _hold(records, chosen), note
    note = (
        "no segment was held out and none differs from the rest; the last fifth of each record is kept from every fit, "
        "which shows less than a run of another amplitude and waveform would"
    )
    return tuple(_cut(r) for r in records), note


def _last_that_differ(records: Sequence[Record]) -> list[_Place]:
    places = [
        _Place(i, j, w.stop - w.start, r.u[w.start : min(w.stop, w.start + COMPARED_ROWS)])
        for i, r in enumerate(records)
        for j, w in enumerate(r.windows)
    ]
    total = sum(p.rows for p in places)
    chosen: list[_Place] = []
    held = 0
    while places and held < WANTED_SHARE * total:
        last, rest = places[-1], places[:-1]
        if not rest or held + last.rows > LARGEST_SHARE * total or not all(_differ(last.u, p.u) for p in rest):
            break
        chosen.append(last)
        held += last.rows
        places = rest
    return chosen if held >= SMALLEST_SHARE * total else []


def _differ(a: Array, b: Array) -> bool:
    """Tell whether two inputs (n, n_u) differ in amplitude or in waveform."""
    size_a, size_b = (np.sqrt(np.mean(x**2, axis=0)) for x in (a, b))
    floor = 1e-3 * max(float(size_a.max()), float(size_b.max()))
    if np.any(np.abs(np.log((size_a + floor) / (size_b + floor))) > np.log(SAME_SIZE)):
        return True
    n = min(a.shape[0], b.shape[0])
    product = float(np.sqrt(np.sum(a[:n] ** 2) * np.sum(b[:n] ** 2)))
    return product > 0.0 and float(np.sum(a[:n] * b[:n])) < SAME_WAVE * product


def _hold(records: Sequence[Record], chosen: Sequence[_Place]) -> tuple[Record, ...]:
    held = {(p.record, p.window) for p in chosen}
    return tuple(
        replace(r, windows=tuple(replace(w, held_out=(i, j) in held) for j, w in enumerate(r.windows)))
        for i, r in enumerate(records)
    )


def _cut(record: Record) -> Record:
    """Return the record with its last fifth held out; the cut is at a whole period where four or more repeat."""
    at = int((1.0 - WANTED_SHARE) * record.n)
    windows: list[Window] = []
    for w in record.windows:
        split = at
        if w.period and w.stop - w.start >= 4 * w.period and w.start < at < w.stop:
            split = w.start + round((at - w.start) / w.period) * w.period
        if w.start < split < w.stop:
            windows += [replace(w, stop=split), replace(w, label=f"{w.label}, end", start=split, held_out=True)]
        else:
            windows.append(replace(w, held_out=w.start >= split))
    return replace(record, windows=tuple(windows))
