"""The five-minute thermal test on the simulated bench: played, logged with its checksum, and its drift measured."""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from analysis.recorded.drift import DriftTest, drift_of
from benchmarks.speed.base import Agreement, Benchmark, Contender, Prepared, at_most_seconds
from benchmarks.speed.commands import Commands
from campaigns.benches import open_bench
from campaigns.log import read_run
from campaigns.plans import make_plan
from campaigns.playing.campaign import run_seed
from campaigns.playing.runner import run_plan

OURS, COMMAND = "run, log and analyse", "mccd thermal --no-sweeps"
CYCLES, QUICK = 1500, 20
SEED = 3


def prepare(quick: bool, folder: Path) -> Prepared:
    """Return the test as a call, and as the command with the start of its process; the logs of both are left."""
    plan = make_plan("thermal", {"cycles": QUICK if quick else CYCLES})
    numbers, commands = count(), Commands(folder)

    def ours() -> DriftTest:
        path = folder / f"thermal-{next(numbers)}.h5"
        seed = run_seed(SEED, "thermal")
        bench = open_bench("sim", seed)
        run_plan(plan, bench, path, seed=seed)
        with read_run(path) as run:
            return drift_of(run)

    def command() -> Any:
        out = str(folder / f"thermal-{next(numbers)}")
        given = ["thermal", "--no-sweeps", "--set", f"cycles={plan.settings()['cycles']}"]
        return json.loads(commands.mccd(*given, "--seed", str(SEED), "--out", out, "--json", may_fail=True).out)

    seconds = plan.settings()["cycles"] / plan.settings()["frequency_hz"]
    return Prepared((Contender(OURS, ours), Contender(COMMAND, command)), check, {}, {"simulated seconds": seconds})


def check(results: Mapping[str, Any]) -> list[Agreement]:
    """Compare the mean positions of all integration periods: the same seed gives the same noise."""
    means = np.array(results[COMMAND]["drift"]["mean_rad"])
    error = float(np.max(np.abs(means - results[OURS].mean_rad)))
    return [Agreement(COMMAND, error, 0.0, "the same numbers, rad")]


BENCHMARK = Benchmark(
    "thermal",
    "five minutes of chopping at 5 Hz on the bench as built, all noises, closed loop, logged, drift measured; one core",
    prepare,
    (at_most_seconds(OURS, 3.0),),
    {},
)
