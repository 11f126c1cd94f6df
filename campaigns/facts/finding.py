"""All facts of a record: `FACTS` is the only list; adding one is a file beside this and a line."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace

import msgspec

from campaigns.facts import clipping, period, rest, size, slow_sensor, steps, wraps
from campaigns.facts.base import Fact, Seen
from campaigns.log.read import Run
from campaigns.log.schema import LogSegment

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
