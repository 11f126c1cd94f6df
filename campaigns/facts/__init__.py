"""What is known of a record before it is used: `FACTS` is the only list; adding one is a file beside this and a line.

Facts are found when data are imported and kept in the log; identification and diagnosis ask them, never the raw rows.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import msgspec
import numpy as np

from campaigns.facts import clipping, period, rest, size, slow_sensor, steps, wraps
from campaigns.facts.base import Fact, Seen, runs_of
from campaigns.log.read import Run
from campaigns.log.schema import LogSegment
from sim_backend.errors import DataError

FACTS: tuple[Callable[[Seen], list[Fact]], ...] = (
    size.facts,
    period.facts,
    rest.facts,
    slow_sensor.facts,
    steps.facts,
    clipping.facts,
    wraps.facts,
)
"""Each finds what it knows how to find, in the order in which a person wants to read it."""


MOST_NUMBERS = 20_000_000
"""Numbers of a log that are looked at, 160 MB. A longer one is known from its import, or by its first rows."""


def found_in(seen: Seen) -> tuple[Fact, ...]:
    """Return the facts of a record; none of one without rows."""
    return tuple(fact for find in FACTS for fact in find(seen)) if seen.rows else ()


def facts_of(run: Run) -> tuple[Fact, ...]:
    """Return the facts of a log, found once per open run; raises DataError where the log cannot be read."""
    return run.once("facts", _facts)


def _facts(run: Run) -> tuple[Fact, ...]:
    columns = sum(channel.role != "aux" for channel in run.channels.values())
    known = stored_facts(run) if run.rows * columns > MOST_NUMBERS else ()
    return known or found_in(seen_in(run))


def stored_facts(run: Run) -> tuple[Fact, ...]:
    """Return the facts that an import left in the log, none where it left none."""
    try:
        return tuple(msgspec.convert(json.loads(run.header.configuration)["facts"], list[Fact], strict=True))
    except (ValueError, KeyError, TypeError, RecursionError, msgspec.ValidationError):
        return ()


def usable_segments(run: Run) -> list[LogSegment]:
    """Return the segments of a log without those in which no output moves, cut where the record has ended.

    Raises DataError for a log that a fact forbids to use.
    """
    facts = facts_of(run)
    for fact in facts:
        if fact.forbids:
            raise DataError(f"{run.path}: {fact.refusal}")
    end = min((int(fact.numbers["start"]) for fact in facts if fact.name == "ended"), default=run.rows)
    still = Counter(fact.segment for fact in facts if fact.name == "at-rest")
    outputs = len(run.names("output"))
    kept = [s for s in run.segments if s.start < end and still[s.label] < max(outputs, 1)]
    if still and not kept:
        raise DataError(f"{run.path}: no output moves in any segment: give a log in which the bench is driven")
    return [_until(s, end) for s in kept]


def _until(segment: LogSegment, end: int) -> LogSegment:
    """Return a segment cut where its record has ended, of a periodic one where the last whole period has."""
    period = segment.settings.get("period_samples")
    if segment.stop <= end:
        return segment
    if isinstance(period, int) and period > 1:
        whole = (end - segment.start) // period * period
        return replace(segment, stop=segment.start + whole) if whole else segment
    return replace(segment, stop=end)


LEAST_PIECE = 100
"""Rows between two stretches at the end of a sensor's range that a fit may begin anew for."""


def measured_segments(run: Run) -> list[LogSegment]:
    """Return the usable segments of a log without the rows in which an output is at the end of its sensor's range.

    What lies between such rows becomes a segment of its own, begun in an unknown state, if it is long enough.
    """
    clipped = [fact for fact in facts_of(run) if fact.name == "clipping"]
    found: list[LogSegment] = []
    for segment in usable_segments(run):
        ends = [(fact.channel, fact.numbers["level"]) for fact in clipped if fact.segment == segment.label]
        if not ends:
            found.append(segment)
            continue
        cut = np.zeros(segment.rows, dtype=bool)
        for channel, level in ends:
            cut |= run.read(channel, segment.start, segment.stop) == level
        starts, stops = runs_of(~cut)
        settings = {name: value for name, value in segment.settings.items() if name != "period_samples"}
        found += [
            replace(segment, start=segment.start + int(a), stop=segment.start + int(b), settings=settings)
            for a, b in zip(starts, stops, strict=True)
            if b - a >= LEAST_PIECE
        ]
    return found


def remarks_on(runs: Sequence[Run]) -> tuple[str, ...]:
    """Return what somebody who uses these logs has to know of them, without being asked."""
    told = (f"{run.path.name}: {fact.told}" for run in runs for fact in facts_of(run) if fact.remark)
    return tuple(dict.fromkeys(told))


def seen_in(run: Run) -> Seen:
    """Return a log as the facts look at it: its inputs, outputs and references in memory, its segments."""
    names = [name for name, channel in run.channels.items() if channel.role != "aux"]
    rows = min(run.rows, MOST_NUMBERS // max(len(names), 1))
    segments = [replace(s, stop=min(s.stop, rows)) for s in run.segments if s.start < rows] or whole(rows)
    columns = {name: run.read(name, 0, rows) for name in names}
    return Seen(columns, {name: run.channels[name] for name in names}, segments, run.sample_rate_hz, rows == run.rows)


def whole(rows: int) -> Sequence[LogSegment]:
    """Return a record without segments as one."""
    return (LogSegment("record", 0, rows, {}),) if rows else ()


__all__ = [
    "FACTS",
    "Fact",
    "Seen",
    "facts_of",
    "found_in",
    "measured_segments",
    "remarks_on",
    "seen_in",
    "stored_facts",
    "usable_segments",
    "whole",
]
