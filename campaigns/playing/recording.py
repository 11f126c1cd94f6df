"""A run that was never written: a plan played into memory, with the same interface as a log that is read."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from campaigns.log import Channel, LogSegment
from campaigns.plans import Plan, checked_segments
from sim_backend.bench import Bench, Record, Segment
from sim_backend.errors import ConfigError

Array = NDArray[np.float64]


class Recorded(Protocol):
    """What measurements need of a run, whether it is a log that is read or in memory."""

    @property
    def path(self) -> Path:
        """What errors call it."""

    @property
    def channels(self) -> Mapping[str, Channel]:
        """Every channel by name."""

    @property
    def segments(self) -> tuple[LogSegment, ...]:
        """Every segment in its order."""

    @property
    def sample_rate_hz(self) -> float:
        """The rate that all channels share."""

    def read(self, name: str, start: int = 0, stop: int | None = None) -> Array:
        """Return samples `start` to `stop` (exclusive; default: all) of a channel as (n,), SI."""


@dataclass(frozen=True)
class Recording:
    """What a bench measured during a whole plan: `channels` and `segments` describe, `read` gives values in SI units.

    `path` is what errors call it. `values` holds every channel in pieces, (n_samples,) of each segment.
    """

    path: Path
    rows: int
    channels: Mapping[str, Channel]
    segments: tuple[LogSegment, ...]
    values: Mapping[str, Sequence[Array]]

    @property
    def sample_rate_hz(self) -> float:
        """The rate that all channels share."""
        return next(iter(self.channels.values())).sample_rate_hz

    def read(self, name: str, start: int = 0, stop: int | None = None) -> Array:
        """Return samples `start` to `stop` (exclusive; default: all) of a channel as (n,); ConfigError for none."""
        if name not in self.values:
            raise ConfigError(f"{self.path} has no channel '{name}'; it has {', '.join(self.values)}")
        first, last, _ = slice(start, stop).indices(self.rows)
        whole = [
            piece[max(first - segment.start, 0) : max(last - segment.start, 0)]
            for segment, piece in zip(self.segments, self.values[name], strict=True)
        ]
        pieces = [piece for piece in whole if piece.size] or whole[:1]
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)


class Planned:
    """Segments of plans, made and checked once for every plan and interface of a bench, however often they are played.

    A plan sees only the interface of a bench, so benches with the same one play the same segments.
    """

    def __init__(self, most: int = 32) -> None:
        self._most = most
        self._made: dict[tuple[object, ...], tuple[Segment, ...]] = {}

    def segments(self, plan: Plan, bench: Bench) -> tuple[Segment, ...]:
        """Return the checked segments of a plan; raises ConfigError for what the bench cannot be asked."""
        limits = bench.limits
        sizes = limits.reference.tobytes(), float(limits.current_a), limits.to_current.tobytes()
        key = (plan.name, json.dumps(plan.settings(), sort_keys=True), bench.axes, bench.signals, *sizes)
        made = self._made.get(key)
        if made is None:
            made = tuple(checked_segments(plan, bench))
            if not made:
                raise ConfigError(f"plan {plan.name}: its settings give nothing to play; ask for at least one step")
            if len(self._made) >= self._most:
                self._made.clear()
            self._made[key] = made
        return made


def play_in_memory(plan: Plan, bench: Bench, planned: Planned | None = None) -> Recording:
    """Play a plan and return its record; raises ConfigError for what the bench cannot be asked, before it moves."""
    segments = (planned or Planned()).segments(plan, bench)
    return joined(plan, bench, segments, [bench.play(segment) for segment in segments])


_channel = lru_cache(maxsize=256)(Channel.of)
"""A bench's signals are the same in every run of a study, and a channel's name, unit and rate are checked."""


def joined(plan: Plan, bench: Bench, segments: Sequence[Segment], played: Sequence[Record]) -> Recording:
    """Return the record of a whole plan from those of its segments."""
    ends = np.cumsum([segment.n_samples for segment in segments]).tolist()
    rows = tuple(
        LogSegment(segment.label, end - segment.n_samples, end, segment.settings)
        for segment, end in zip(segments, ends, strict=True)
    )
    wanted = set(plan.channels(bench))
    channels = {signal.name: _channel(signal) for signal in bench.signals if signal.name in wanted}
    values = {name: [record.channels[name] for record in played] for name in channels}
    return Recording(Path(plan.name), ends[-1], channels, rows, values)
