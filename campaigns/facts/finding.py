"""All facts of a record: `FACTS` is the only list; adding one is a file beside this and a line."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import msgspec

from campaigns.facts import (
    clipping,
    clock,
    coherence,
    dead,
    delay,
    loop,
    missing,
    period,
    plausible,
    precision,
    resampled,
    rest,
    size,
    slow_sensor,
    steps,
    transient,
    unbroken,
    wraps,
)
from campaigns.facts.base import Fact, Seen
from campaigns.facts.stretches import Stretch, stretches_in
from campaigns.log.read import Run
from campaigns.log.schema import LogSegment
from sim_backend.readings import with_gaps

FACTS: tuple[Callable[[Seen], list[Fact]], ...] = (
    size.facts,
    plausible.facts,
    period.facts,
    dead.facts,
    rest.facts,
    slow_sensor.facts,
    steps.facts,
    clipping.facts,
    wraps.facts,
)
"""Each finds what it knows how to find, in the order in which a person wants to read it."""


RELATIONS: Mapping[str, Callable[[Seen, Sequence[Stretch], Sequence[Fact]], list[Fact]]] = {
    transient.NAME: transient.facts,
    unbroken.NAME: unbroken.facts,
    clock.NAME: clock.facts,
    loop.NAME: loop.facts,
    delay.NAME: delay.facts,
    coherence.NAME: coherence.facts,
}
"""What is asked of inputs and outputs together, knowing what has been found before. These cost more: an import keeps
which of them it has asked."""

MOST_NUMBERS = 20_000_000
"""Numbers of a log that are looked at, 160 MB. A longer one is known from its import, or by its first samples."""


def found_in(seen: Seen, asked: Sequence[str] = tuple(RELATIONS)) -> tuple[Fact, ...]:
    """Return the facts of a record, of `RELATIONS` those that are `asked`; none of one without samples."""
    if not seen.rows:
        return ()
    found = missing.facts(seen)
    seen = missing.drawn_over(seen) if found else seen
    if not seen.columns:
        return tuple(found)
    found += [fact for find in FACTS for fact in find(seen)]
    stretches = stretches_in(seen, found) if asked else []
    for name in asked:
        found += RELATIONS[name](seen, stretches, found)
    return tuple(found)


def facts_of(run: Run) -> tuple[Fact, ...]:
    """Return the facts of a log, found once per open run; raises DataError where the log cannot be read.

    Of `RELATIONS` those that an import has asked: to ask them takes longer than a diagnosis of a short log.
    """
    return run.once("facts", lambda run: _facts(run, ()))


def all_facts_of(run: Run) -> tuple[Fact, ...]:
    """Return the facts of a log, those of `missing_in` asked now; raises DataError where the log cannot be read."""
    return run.once("all facts", lambda run: _facts(run, missing_in(run)))


def missing_in(run: Run) -> tuple[str, ...]:
    """Return which of `RELATIONS` an import has not asked."""
    try:
        asked = json.loads(run.header.configuration)["asked"]
        whole = run.status == "complete" and isinstance(asked, list)
    except (ValueError, KeyError, TypeError, RecursionError):
        whole = False
    return tuple(name for name in RELATIONS if not whole or name not in asked)


def _facts(run: Run, asked: Sequence[str]) -> tuple[Fact, ...]:
    columns = sum(channel.role != "aux" for channel in run.channels.values())
    stored = stored_facts(run)
    if stored and run.rows * columns > MOST_NUMBERS:
        return stored
    kept = {precision.NAME, *RELATIONS} - set(missing_in(run))
    made = [fact for fact in stored if _only_at_import(run, fact)]
    return (*made, *found_in(seen_in(run), asked), *(fact for fact in stored if fact.name in kept))


def _only_at_import(run: Run, fact: Fact) -> bool:
    """Tell whether a stored fact is found by an import only, not in a log's inputs, outputs and references."""
    channel = run.channels.get(fact.channel)
    return fact.name == resampled.NAME or (channel is not None and channel.role == "aux")


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
    columns = {name: with_gaps(run.stored(name, 0, rows)) for name in names}
    return Seen(columns, {name: run.channels[name] for name in names}, segments, run.sample_rate_hz, rows == run.rows)


def whole(rows: int) -> Sequence[LogSegment]:
    """Return a record without segments as one."""
    return (LogSegment("record", 0, rows, {}),) if rows else ()
