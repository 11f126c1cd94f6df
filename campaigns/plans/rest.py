"""Nothing is driven: the noise of the bench at rest, from which feedback is weighed."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from campaigns.plans.base import Plan, channels_of, open_loop, rate_of
from campaigns.sizes import samples_of
from sim_backend.bench import Bench, Segment


class Rest(Plan, frozen=True, kw_only=True):
    """All loops open and all drives zero for `duration_s`, recorded after `settle_s`."""

    name: ClassVar[str] = "rest"
    title: ClassVar[str] = "noise at rest"

    duration_s: float = 20.0
    settle_s: float = 1.0

    def __post_init__(self) -> None:
        self.require_positive("duration_s", "settle_s")

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return commands and readings."""
        return channels_of(bench, ("input", "output"))

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield the wait and the record."""
        rate, record = rate_of(bench), self.channels(bench)
        for label, seconds in (("settling in", self.settle_s), ("rest", self.duration_s)):
            yield open_loop(label, np.zeros((1, len(bench.axes))), samples_of(seconds, rate), record, {"phase": label})
