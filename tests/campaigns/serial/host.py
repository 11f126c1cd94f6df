"""A host process for tests that interrupt or kill it: plays a plan on the bench at ADDRESS into the log LOG.

Arguments: ADDRESS LOG SEGMENT_S. Says `playing LABEL` before each segment and how the run ended.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from campaigns.benches import open_bench
from campaigns.plans import Plan
from campaigns.plans.base import open_loop
from campaigns.playing.runner import run_plan
from campaigns.sizes import samples_of
from sim_backend.bench import Bench, Segment

RATE_HZ = 10_000.0


class Slow(Plan, frozen=True):
    """Ten segments of a small torque."""

    name: ClassVar[str] = "slow"
    title: ClassVar[str] = "Ten segments"
    segment_s: float

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield ten."""
        for number in range(1, 11):
            wave = np.full((1, len(bench.axes)), 1e-5)
            yield open_loop(str(number), wave, samples_of(self.segment_s, RATE_HZ), self.channels(bench), {})


def _report(_done: float, _total: float, label: str) -> None:
    print("playing", label, flush=True)


if __name__ == "__main__":
    with contextlib.closing(open_bench(sys.argv[1], 0)) as bench:
        outcome = run_plan(Slow(segment_s=float(sys.argv[3])), bench, sys.argv[2], seed=0, report=_report)
    print(outcome.status, flush=True)
