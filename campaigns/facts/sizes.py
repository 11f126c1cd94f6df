"""How large every channel of a log is, from its import or from its samples."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

from campaigns.facts.finding import MOST_NUMBERS, stored_facts
from campaigns.facts.size import NAME, Size, size_of
from campaigns.log.read import Run
from sim_backend.errors import DataError
from sim_backend.readings import with_gaps

SIZES = tuple(field.name for field in fields(Size))


@dataclass(frozen=True)
class Sizes:
    """Size of each channel that holds a number, of the first `samples` of a log, and the channels without one, why."""

    by_channel: Mapping[str, Size]
    samples: int
    unknown: Mapping[str, str]


def sizes_of(run: Run) -> Sizes:
    """Return the sizes of all channels; at most `MOST_NUMBERS` numbers are read, one channel at a time."""
    kept = _kept(run)
    if kept.keys() == run.channels.keys():
        return Sizes(kept, run.rows, {})
    samples = min(run.rows, MOST_NUMBERS // len(run.channels))
    found: dict[str, Size] = {}
    unknown: dict[str, str] = {}
    for name in run.channels:
        try:
            size = size_of(with_gaps(run.stored(name, 0, samples)))
        except DataError as error:
            unknown[name] = str(error)
            continue
        if size is None:
            unknown[name] = "it holds no number"
        else:
            found[name] = size
    return Sizes(found, samples, unknown)


def _kept(run: Run) -> dict[str, Size]:
    """Return the sizes that an import left in a log, which says what it likes: none that is incomplete."""
    if run.status != "complete":
        return {}
    told = {fact.channel: fact.numbers for fact in stored_facts(run) if fact.name == NAME}
    return {
        name: Size(*(numbers[key] for key in SIZES))
        for name, numbers in told.items()
        if all(math.isfinite(numbers.get(key, math.nan)) for key in SIZES)
    }
