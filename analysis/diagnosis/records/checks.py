"""Whether records can decide anything: refused with a reason where they cannot, told where they decide less."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.records.dataset import Mask, Record, Window
from campaigns.facts import Fact
from campaigns.facts.base import stretches_of
from campaigns.facts.clipping import NAME, cut_off
from sim_backend.errors import DataError

MIN_ROWS = 60
"""Fewest rows that a fit may use: three per output would fit a noise model alone."""

SHORTEST = 8
"""Rows between two cut-off stretches that are worth a window."""


def check_outputs(records: Sequence[Record], names: Sequence[str], where: str) -> None:
    """Raise DataError when an output (its `names` in order) of the `records` of the log `where` is dead."""
    for o, name in enumerate(names):
        low = min(float(r.y[:, o].min()) for r in records)
        high = max(float(r.y[:, o].max()) for r in records)
        if low == high:
            raise DataError(
                f"{where}: output '{name}' is constant at {low:g} in all rows; a dead channel decides nothing: "
                "leave this run out or mend the channel"
            )


def without_cut_off(
    records: Sequence[Record], names: Sequence[str], facts: Sequence[Fact]
) -> tuple[list[Record], list[str]]:
    """Return the records without the rows where the `facts` say that an output is cut off, and notes.

    Such rows are simulated like all others, but neither fitted nor judged. The outputs of the records have these
    `names`, in order.
    """
    told = [fact for fact in facts if fact.name == NAME and fact.channel in names]
    kept = []
    for record in records:
        cut = np.zeros(record.n, dtype=bool)
        for w in record.windows:
            columns = dict(zip(names, record.y[w.start : w.stop].T, strict=True))
            cut[w.start : w.stop] = cut_off(told, w.label, w.stop - w.start, columns.__getitem__)
        kept.append(replace(record, windows=_around(record.windows, cut), missing=cut) if cut.any() else record)
    notes = [f"{fact.finding}, as a saturated sensor is; those rows are left out" for fact in told]
    if notes and not any(record.windows for record in kept):
        raise DataError(
            f"an output is cut off every few rows ({notes[0].partition(';')[0]}): no stretch of {SHORTEST} rows is "
            "left between; record with a smaller motion or a wider range"
        )
    return kept, notes


def _around(windows: Sequence[Window], cut: Mask) -> tuple[Window, ...]:
    """Return the pieces of windows in which nothing is `cut` (n,); what is left of periods repeats no more."""
    pieces = []
    for w in windows:
        if not cut[w.start : w.stop].any():
            pieces.append(w)
            continue
        pieces += [
            replace(w, start=w.start + a, stop=w.start + b, period=0)
            for a, b in stretches_of(~cut[w.start : w.stop], SHORTEST)
        ]
    return tuple(pieces)


def check_inputs(records: Sequence[Record], names: Sequence[str]) -> list[str]:
    """Return a note on inputs (their `names` in order) that never move; raises DataError when none does."""
    moves = np.any([np.ptp(r.u, axis=0) > 0.0 for r in records], axis=0)
    if not np.any(moves):
        raise DataError(
            "every input is constant in all runs; nothing was excited, so nothing can be judged: give a run in which "
            "the bench is driven"
        )
    still = [name for name, m in zip(names, moves, strict=True) if not m]
    return [f"input {', '.join(still)} never moves; nothing can be said about it"] if still else []


def check_enough(records: Sequence[Record], where: str) -> None:
    """Raise DataError when too few rows of the `records` of the logs `where` may be fitted."""
    fitted = sum(int(r.fitted().sum()) for r in records)
    if fitted < MIN_ROWS:
        raise DataError(
            f"{where}: {fitted} rows may be fitted, at least {MIN_ROWS} are needed to tell an effect from noise; "
            "record more"
        )


def without_copies(records: Sequence[Record], names: Sequence[str]) -> tuple[tuple[Record, ...], list[str]]:
    """Return the records, their periods forgotten where those of an output are copies of each other, and a note.

    Averaged periods that were tiled, and readings coarser than any noise, differ by nothing: the noise would be zero.
    """
    largest = np.zeros(len(names))
    seen = False
    for record in records:
        for w in record.windows:
            if w.period and w.stop - w.start >= 2 * w.period:
                y = record.y[w.start : w.stop]
                largest = np.maximum(largest, np.max(np.abs(y[w.period :] - y[: -w.period]), axis=0))
                seen = True
    copied = [name for name, difference in zip(names, largest, strict=True) if difference == 0.0]
    if not seen or not copied:
        return tuple(records), []
    plain = tuple(replace(r, windows=tuple(replace(w, period=0) for w in r.windows)) for r in records)
    return plain, [
        f"the periods of {', '.join(copied)} are copies of each other, which tell nothing of the noise; periods are "
        "taken as not repeating: give the record as it was measured, not averaged"
    ]
