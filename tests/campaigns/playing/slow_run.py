"""a process that plays slowly and says what happens, for tests that interrupt or kill it.

Arguments: `run LOG -` or `campaign FILE FOLDER`; in a campaign the bench is slow only while SLOW_S is set.
"""

from __future__ import annotations

import os
import sys
import time

import campaigns.benches
from campaigns.plans import make_plan
from campaigns.playing.campaign import load_campaign
from campaigns.playing.campaign_run import run_campaign
from campaigns.playing.runner import run_plan
from sim_backend.simbench import SimBench
from tests.small_bench import NOISE, bench_model

SLOW_S = float(os.environ.get("SLOW_S", "0"))


class SlowBench(SimBench):
    """The small bench, taking its time and saying what it does."""

    def play(self, segment):
        print("playing", segment.label, flush=True)
        record = super().play(segment)
        print("waiting", segment.label, flush=True)
        time.sleep(SLOW_S)
        return record

    def safe(self):
        super().safe()
        print("safe", flush=True)


def open_small(_address: str, seed: int, _disturbance: float = 1.0) -> SlowBench:
    return SlowBench(bench_model(NOISE), seed)


if __name__ == "__main__":
    what, first, second = sys.argv[1:]
    if what == "run":
        plan = make_plan("sinesweep", {"bands": [{"start_hz": 10.0, "stop_hz": 100.0, "step_hz": 10.0}]})
        outcome = run_plan(plan, open_small("", 1), first, seed=1)
        print(outcome.status, flush=True)
    else:
        kind = campaigns.benches.BenchKind("small", "", open_small, lambda _address: "small", repeatable=True)
        campaigns.benches.BENCHES["small"] = kind
        print(run_campaign(load_campaign(first), second, address="small", seed=5, resume=True).status, flush=True)
