"""Programs that `benchmarks.study_cost` measures, each in a process of its own; what they print is JSON.

python -m benchmarks.study_trials shares TRIALS
python -m benchmarks.study_trials nothing FOLDER TRIALS --workers 4
python -m benchmarks.study_trials nothing FOLDER TRIALS --cluster tcp://HOST:PORT
python -m benchmarks.study_trials made-up FOLDER TRIALS FINISHING_AT_ONCE
python -m benchmarks.study_trials wait tcp://HOST:PORT WORKERS
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from analysis.study import run as study_run
from analysis.study.definition import SCHEMA, Study, load_study
from analysis.study.engines import groups_of
from analysis.study.fingerprint import fingerprint
from analysis.study.kinds import KINDS, played
from analysis.study.output import write_results
from analysis.study.store import Store
from analysis.study.summary import summarise
from analysis.study.trial import Job, Outcome, run_trials
from benchmarks.study_nothing import NothingTrial, dask_setup
from campaigns.playing.recording import Planned
from sim_backend import noise
from sim_backend.kernel import machine
from sim_backend.memory import keep_freed_memory
from sim_backend.simbench import SimBench

SPREAD = Path(__file__).parents[1] / "docs" / "examples" / "spread.toml"
WARM = 200
"""Trials before any is timed: five million samples, of which two suffice for a loop with its effects inlined."""


class Clock:
    """Processor seconds of this thread by stage, each without the stages that it calls.

    `free_s` is what calls spend without Python's lock. Other programs change these seconds little.
    """

    def __init__(self) -> None:
        self.stage_s: dict[str, float] = {}
        self.free_s: dict[str, float] = {}
        self._inner: list[float] = []
        self._stages: list[str] = []

    def stage(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, its time counted to a stage."""

        def timed(*args: Any, **more: Any) -> Any:
            self._inner.append(0.0)
            self._stages.append(name)
            started = time.thread_time()
            try:
                return function(*args, **more)
            finally:
                took = time.thread_time() - started
                self._stages.pop()
                self.stage_s[name] = self.stage_s.get(name, 0.0) + took - self._inner.pop()
                if self._inner:
                    self._inner[-1] += took

        return timed

    def free(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a compiled function that leaves the lock to other threads, its time counted as such."""

        def timed(*args: Any) -> Any:
            started = time.thread_time()
            try:
                return function(*args)
            finally:
                stage = self._stages[-1]
                self.free_s[stage] = self.free_s.get(stage, 0.0) + time.thread_time() - started

        return timed

    def freeing(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, what it returns counted as such."""
        return lambda *args: self.free(function(*args))

    def take(self) -> tuple[dict[str, float], dict[str, float]]:
        """Return both tables and begin anew."""
        taken = self.stage_s, self.free_s
        self.stage_s, self.free_s = {}, {}
        return taken


STAGES: tuple[tuple[object, str, str], ...] = (
    (Job, "varied", "draw"),
    (Job, "setup", "model"),
    (played, "make_plan", "plan"),
    (Planned, "segments", "plan"),
    (SimBench, "__init__", "bench"),
    (played, "play_side_by_side", "play"),
    (played, "joined", "record"),
    (KINDS["settling"], "measured", "measure"),
)
"""Whose function belongs to which stage; `record` is what playing takes besides: joining segments to one record."""

FREE: tuple[tuple[object, str], ...] = ((machine, "loop_of"), (noise, "filling"))
"""Whose results leave Python's lock to others: the loop, and what draws. numpy does so too, within long operations,
which is not counted."""


@contextmanager
def clocked() -> Iterator[Clock]:
    """Give a clock that runs while trials do."""
    clock = Clock()
    changes: list[tuple[Any, str, Any]] = [
        (owner, name, clock.stage(s, getattr(owner, name))) for owner, name, s in STAGES
    ]
    changes += [(owner, name, clock.freeing(getattr(owner, name))) for owner, name in FREE]
    before = [(owner, name, vars(owner).get(name)) for owner, name, _ in changes]
    for owner, name, function in changes:
        setattr(owner, name, function)
    try:
        yield clock
    finally:
        for owner, name, function in before:
            if function is None:  # that of the class shows again
                delattr(owner, name)
            else:
                setattr(owner, name, function)


def shares(trials: int, warm: int = WARM, *, give_back: bool = False) -> dict[str, Any]:
    """Return where the time of a settling trial goes, as means over `trials`, after `warm` others.

    The process keeps what trials free, as an engine does, or gives it back to the system.
    """
    if not give_back:
        keep_freed_memory()
    job = Job.of(load_study(SPREAD))
    for group in groups_of(range(warm), len(job.study.points)):
        run_trials(job, group)
    whole_s, stage_s, free_s = 0.0, Counter[str](), Counter[str]()
    faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    with clocked() as clock:
        # draws that no trial has made before
        for group in groups_of(range(warm, warm + trials), len(job.study.points)):
            started = time.thread_time()
            outcomes = run_trials(job, group)
            whole_s += time.thread_time() - started
            for outcome in outcomes:
                if outcome.status != "done":
                    raise SystemExit(f"trial {outcome.trial} of spread.toml {outcome.status}: {outcome.reason}")
            for total, table in zip((stage_s, free_s), clock.take(), strict=True):
                total.update(table)
    faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - faults
    trial_ms = 1e3 * whole_s / trials
    names = [*dict.fromkeys(stage for _, _, stage in STAGES)]
    ms, free_ms = ({name: 1e3 * total[name] / trials for name in names} for total in (stage_s, free_s))
    stages = {
        name: {
            "ms": round(ms[name], 3),
            "share": round(ms[name] / trial_ms, 3),
            "without_lock_ms": round(free_ms[name], 3),
        }
        for name in names
    }
    return {
        "study": "spread",
        "trials": trials,
        "keeps_freed_memory": not give_back,
        "page_faults_per_trial": round(faults / trials, 1),
        "trial_ms": round(trial_ms, 3),
        "stages": stages,
        "without_lock_share": round(sum(free_ms.values()) / trial_ms, 3),
    }


def nothing(folder: Path, trials: int, workers: int | None, address: str | None) -> dict[str, Any]:
    """Run a study of trials that do nothing and return how fast they went and how long its disk took of that."""
    dask_setup()
    kept_s: list[float] = []
    add = Store.add

    def timed(self: Store, outcomes: list[Outcome]) -> None:
        started = time.perf_counter()
        add(self, outcomes)
        kept_s.append(time.perf_counter() - started)

    setattr(Store, "add", timed)  # noqa: B010  (a measurement, which the type of a method forbids)
    content = {"schema": SCHEMA, "name": "nothing", "kind": NothingTrial.name, "trials": trials}
    outcome = study_run.run_study(msgspec.convert(content, Study), folder, workers=workers, address=address)
    timing = outcome.timing
    return {
        "trials": timing.trials,
        "trials_wall_s": round(timing.wall_s, 3),
        "trials_per_s": round(timing.trials / timing.wall_s, 1),
        "store_s": round(sum(kept_s), 3),
        "transactions": len(kept_s),
        "store_ms_per_transaction": round(1e3 * sum(kept_s) / len(kept_s), 3),
    }


def made_up(folder: Path, trials: int, batch: int) -> dict[str, Any]:
    """Keep and conclude a study of settling trials that were made up, `batch` of them finishing at once."""
    job = Job.of(msgspec.structs.replace(load_study(SPREAD), trials=trials // 2))  # of two points
    rng = np.random.default_rng(0)
    cut = len(job.varied_names)
    with Store(folder, fingerprint(job), job.varied_names, job.columns, resume=False) as store:
        started = time.perf_counter()
        for first in range(0, trials, batch):
            made = []
            for trial in range(first, min(first + batch, trials)):
                numbers = rng.random(cut + len(job.columns)).tolist()
                made.append(Outcome(trial, "done", "", tuple(numbers[:cut]), tuple(numbers[cut:]), 0.1))
            store.add(made)
        kept = time.perf_counter()
        write_results(job, store, summarise(job, store), folder)
        ended = time.perf_counter()
    return {"keep_s": kept - started, "conclude_s": ended - kept}


def wait(address: str, workers: int) -> dict[str, Any]:
    """Return when a cluster has so many workers."""
    from distributed import Client

    connect: Any = Client
    with connect(address, timeout=60.0, set_as_default=False) as client:
        client.wait_for_workers(workers, timeout=120.0)
    return {"workers": workers}


def main(arguments: list[str] | None = None) -> int:
    """Do one of them and print what it found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parts = parser.add_subparsers(dest="part", required=True)
    one = parts.add_parser("shares")
    one.add_argument("trials", type=int)
    one.add_argument("--give-back", action="store_true", help="give freed memory back to the system")
    one = parts.add_parser("nothing")
    one.add_argument("folder", type=Path)
    one.add_argument("trials", type=int)
    one.add_argument("--workers", type=int)
    one.add_argument("--cluster", dest="address")
    one = parts.add_parser("made-up")
    one.add_argument("folder", type=Path)
    one.add_argument("trials", type=int)
    one.add_argument("batch", type=int)
    one = parts.add_parser("wait")
    one.add_argument("address")
    one.add_argument("workers", type=int)
    given = vars(parser.parse_args(arguments))
    programs: dict[str, Callable[..., dict[str, Any]]] = {
        "shares": shares,
        "nothing": nothing,
        "made-up": made_up,
        "wait": wait,
    }
    print(json.dumps(programs[given.pop("part")](**given)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
