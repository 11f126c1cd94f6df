"""A fact about a record, and the record as facts look at it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from campaigns.log.schema import ChannelLike, LogSegment

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Fact:
    """What was found, where, and what it means for identification and diagnosis.

    `name` says of which kind it is, `numbers` hold what programs need; `channel` and `segment` are empty where it is of
    all. One that `forbids` makes wrong whatever is computed from the record as it is; one that `refuses_import` as well
    knows what to write into the map instead. One that is not a `remark` is shown when asked for only.
    """

    name: str
    finding: str
    means: str = ""
    channel: str = ""
    segment: str = ""
    numbers: Mapping[str, float] = field(default_factory=dict)
    forbids: bool = False
    refuses_import: bool = False
    remark: bool = True

    @property
    def told(self) -> str:
        """The finding and what it means, for who has not asked."""
        return f"{self.finding}; {self.means}"

    @property
    def refusal(self) -> str:
        """Why the record cannot be used, and where that was found."""
        return f"{self.finding} ({self.segment or self.channel}); {self.means}"


@dataclass(frozen=True)
class Seen:
    """A record: its columns (n,) in SI by channel, what they are, its segments, its rate; `complete` to its end."""

    columns: Mapping[str, Array]
    channels: Mapping[str, ChannelLike]
    segments: Sequence[LogSegment]
    rate_hz: float
    complete: bool = True

    def of_role(self, *roles: str) -> dict[str, Array]:
        """Return the columns (n,) of these roles, by channel."""
        return {name: values for name, values in self.columns.items() if self.channels[name].role in roles}

    @property
    def rows(self) -> int:
        """Number of samples."""
        return next((values.size for values in self.columns.values()), 0)


def runs_of(at: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where the stretches begin and end (exclusive) in which `at` (n,) holds."""
    padded = np.zeros(at.size + 2, dtype=np.int8)
    padded[1:-1] = at
    edges = np.diff(padded)
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)


def changed(values: Array) -> NDArray[np.bool_]:
    """Return after which samples a column (n,) changes, shape (n - 1,): differences take eight times the memory."""
    return np.asarray(values[1:] != values[:-1])


def stretches_of(at: NDArray[np.bool_], least: int = 1) -> list[tuple[int, int]]:
    """Return where the stretches of `least` samples and more begin and end (exclusive) in which `at` (n,) holds."""
    return [(int(a), int(b)) for a, b in zip(*runs_of(at), strict=True) if b - a >= least]


def by_segment(seen: Seen, values: Array) -> Iterator[tuple[LogSegment, Array]]:
    """Yield every segment with samples and its part of a column (n,)."""
    for segment in seen.segments:
        if segment.rows:
            yield segment, values[segment.start : segment.stop]
