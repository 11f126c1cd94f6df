"""Run a study into a folder: what is missing is tried, what is finished is kept, whatever ended the program before."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.study.definition import Study
from analysis.study.engines import Engine, cluster, threads
from analysis.study.fingerprint import fingerprint
from analysis.study.output import write_results
from analysis.study.store import Store
from analysis.study.summary import Summary, summarise
from analysis.study.trial import Job
from campaigns.playing.interrupts import Interrupts
from campaigns.playing.runner import Report

AT_ONCE = 65_536
"""Trials that are looked up together: their numbers take half a megabyte, however many trials a study has."""


@dataclass(frozen=True)
class Timing:
    """What this run took: trials done now, seconds from the first to the last, mean seconds of a trial of the study."""

    trials: int
    wall_s: float
    trial_s: float


@dataclass(frozen=True)
class StudyOutcome:
    """How a study stands: `complete`, or `paused` by the user; its results, files and timing."""

    status: str
    summary: Summary
    files: dict[str, Path]
    timing: Timing


def free_cores() -> int:
    """Return how many cores this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # a system that cannot tell
        return os.cpu_count() or 1


def run_study(
    study: Study,
    folder: str | Path,
    *,
    workers: int | None = None,
    address: str | None = None,
    resume: bool = False,
    report: Report | None = None,
) -> StudyOutcome:
    """Try what `folder` lacks of a study, in `workers` threads or on the cluster at `address`, and write its results.

    Every trial is on the disk before it counts as finished. After the first Ctrl-C no more trials are begun, and
    the study is *paused* when those that run are done; the second abandons them. Raises ConfigError for a study that
    cannot be and for the folder of another one, DataError when the disk fails, HardwareError when the cluster does.
    """
    job = Job.of(study)
    parts = fingerprint(job)
    home, wall_s = Path(folder), 0.0
    with Store(home, parts, job.varied_names, job.columns, resume=resume) as store:
        before = store.finished(study.total)
        tried, there = 0, int(np.count_nonzero(before))
        with Interrupts() as signals:
            tally = _Tally(report, study.total - there, there)
            if there < study.total:
                started = time.monotonic()
                with _engine(job, parts, workers, address) as engine, signals.abortable():
                    missing = study.total - there
                    for batch in engine.outcomes(missing_trials(before), missing, lambda: signals.pausing):
                        if batch:
                            store.add(batch)
                        tried += len(batch)
                        tally.add(len(batch), sum(o.status != "done" for o in batch), engine.workers())
                wall_s = time.monotonic() - started
        summary = summarise(job, store)
        files = write_results(job, store, summary, home)
        finished = summary.finished
        timing = Timing(tried, wall_s, store.seconds(study.total) / max(finished, 1))
    return StudyOutcome("complete" if finished == study.total else "paused", summary, files, timing)


def missing_trials(there: NDArray[np.bool_]) -> Iterator[int]:
    """Yield the trials that are not there (total,), in their order, found a block at a time."""
    for first in range(0, there.size, AT_ONCE):
        yield from (first + np.flatnonzero(~there[first : first + AT_ONCE])).tolist()


def _engine(
    job: Job, parts: dict[str, str], workers: int | None, address: str | None
) -> contextlib.AbstractContextManager[Engine]:
    return threads(job, workers or free_cores()) if address is None else cluster(job, parts, address)


class _Tally:
    """Counts what is done now, so that the remaining time is estimated from this run alone."""

    def __init__(self, report: Report | None, missing: int, before: int) -> None:
        self._report, self._missing, self._before = report, missing, before
        self._done = self._failed = 0

    def add(self, done: int, failed: int, workers: int) -> None:
        """Count finished trials, some of which came to nothing, and say so, and whether anybody is at work."""
        self._done, self._failed = self._done + done, self._failed + failed
        if self._report is not None:
            what = f"{self._before + self._done} of {self._before + self._missing} trials"
            failed_too = f", {self._failed} came to nothing" if self._failed else ""
            alone = "" if workers else ", no worker: waiting"
            self._report(self._done, self._missing, what + failed_too + alone)
