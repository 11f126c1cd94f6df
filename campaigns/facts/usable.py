"""What facts leave of a record: segments that move, cut where it has ended and where a sensor is at its end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial

from campaigns.facts.base import stretches_of
from campaigns.facts.clipping import cut_off
from campaigns.facts.finding import facts_of
from campaigns.facts.missing import missing_rows
from campaigns.facts.rest import AT_REST
from campaigns.log.read import Run
from campaigns.log.schema import LogSegment
from sim_backend.errors import DataError


def usable_segments(run: Run) -> list[LogSegment]:
    """Return the segments of a log without those in which no output moves, cut where the record has ended.

    Raises DataError for a log that a fact forbids to use.
    """
    facts = facts_of(run)
    for fact in facts:
        if fact.forbids:
            raise DataError(f"{run.path}: {fact.refusal}")
    end = min((int(fact.numbers["start"]) for fact in facts if fact.name == "ended"), default=run.rows)
    still = Counter(fact.segment for fact in facts if fact.name == AT_REST)
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
"""Samples between two stretches at the end of a sensor's range that a fit may begin anew for."""


def measured_segments(run: Run) -> list[LogSegment]:
    """Return the usable segments of a log without the samples that are no measurement.

    There an output is at the end of its sensor's range, or an input, output or reference holds no number. What lies
    between such samples becomes a segment of its own, begun in an unknown state, if it is long enough.
    """
    facts = facts_of(run)
    found: list[LogSegment] = []
    for segment in usable_segments(run):
        read = partial(run.read, start=segment.start, stop=segment.stop)
        cut = cut_off(facts, segment.label, segment.rows, read) | missing_rows(run, segment)
        if not cut.any():
            found.append(segment)
            continue
        settings = {name: value for name, value in segment.settings.items() if name != "period_samples"}
        found += [
            replace(segment, start=segment.start + a, stop=segment.start + b, settings=settings)
            for a, b in stretches_of(~cut, LEAST_PIECE)
        ]
    return found


def remarks_on(runs: Sequence[Run], channels: Collection[str] | None = None) -> tuple[str, ...]:
    """Return what somebody who uses these logs has to know of them, without being asked.

    With `channels` only what concerns these, or no channel in particular.
    """
    told = (
        f"{run.path.name}: {fact.told}"
        for run in runs
        for fact in facts_of(run)
        if fact.remark and (channels is None or not fact.channel or fact.channel in channels)
    )
    return tuple(dict.fromkeys(told))
