"""Play a plan on a bench: check every segment first, then play, log and report one by one; leave the bench safe."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from campaigns.log import LogWriter
from campaigns.log.disk_space import require_free
from campaigns.plans.base import Estimate, Plan, checked_segments, estimate
from campaigns.playing.interrupts import Interrupts
from campaigns.strategies.overload import RunWatch
from campaigns.version import tool_commit, tool_version
from sim_backend.bench import Bench, Record, Segment
from sim_backend.errors import CheckError, MccdError

Report = Callable[[float, float, str], None]
"""Called with samples played, samples in all, and the label of what is being played."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended: its log, `status` (complete, paused) with its reason, and what was played of the estimate."""

    path: Path
    run_uid: str
    status: str
    reason: str
    segments: int
    estimate: Estimate


def configuration_of(plan: Plan) -> str:
    """Return the plan's configuration as the JSON text in its logs."""
    return json.dumps(plan.configuration(), sort_keys=True)


def fingerprint_of(configuration: str, seed: int | None, bench: Mapping[str, str]) -> str:
    """Return a digest of everything that decides a run, as its log holds it."""
    whole = {"configuration": configuration, "seed": seed, "bench": dict(bench)}
    return hashlib.sha256(json.dumps(whole, sort_keys=True).encode()).hexdigest()


def fingerprint(plan: Plan, bench: Bench, seed: int) -> str:
    """Return the same digest before anything is played."""
    return fingerprint_of(configuration_of(plan), seed, _identity(bench))


def run_plan(
    plan: Plan,
    bench: Bench,
    path: str | Path,
    *,
    seed: int,
    report: Report | None = None,
    run_uid: str | None = None,
    interrupts: Interrupts | None = None,
    counted: Estimate | None = None,
    note: str = "",
) -> Outcome:
    """Play `plan` on `bench` into a new log at `path` and return how it ended.

    Nothing moves unless all segments keep the bench's limits; `counted` is the estimate of a caller who has made sure.
    `note` is written to the log.
    The first Ctrl-C ends the run after its segment as *paused*, the second as *aborted* (KeyboardInterrupt), an error
    as *failed*; the bench is made safe in each case.
    Raises ConfigError for what the bench cannot be asked, DataError for a log that cannot be written (a segment for
    which the disk has no room is not played), HardwareError for a bench that fails, CheckError for a chop that the
    plan's watch has stopped.
    """
    total = counted or estimate(plan, bench)
    require_free(Path(path).absolute().parent, total.bytes)
    channels = set(plan.channels(bench))
    writer = LogWriter.create(
        path,
        [s for s in bench.signals if s.name in channels],
        test=plan.name,
        bench=_identity(bench),
        configuration=configuration_of(plan),
        seed=seed,
        run_uid=run_uid,
        tool_version=tool_version(),
        tool_commit=tool_commit(),
        expected_rows=total.samples,
        expected_segments=total.segments,
        note=note,
    )
    with _own(interrupts) as signals, writer:
        try:
            played = _play_all(plan, bench, writer, total, signals, report)
        finally:
            bench.safe()
        if played < total.segments:
            writer.set_status("paused", f"interrupted by the user after segment {played} of {total.segments}")
    return Outcome(Path(path), writer.run_uid, writer.status, writer.status_reason, played, total)


def _own(interrupts: Interrupts | None) -> contextlib.AbstractContextManager[Interrupts]:
    """Handlers of this run's own, or those of the campaign around it, which outlive the run."""
    return Interrupts() if interrupts is None else contextlib.nullcontext(interrupts)


def _play_all(
    plan: Plan, bench: Bench, writer: LogWriter, total: Estimate, signals: Interrupts, report: Report | None
) -> int:
    """Play and log segment after segment until the end or a pause; return how many were played.

    Raises CheckError once the plan's watch has stopped it and its fallback has been played.
    """
    played, samples = 0, 0
    watch = plan.watch(bench)
    for segment in checked_segments(plan, bench):
        if signals.pausing:
            break
        if report is not None:
            report(samples, total.samples, segment.label)
        record = _play(segment if watch is None else watch.asked(segment), segment, bench, writer, signals)
        played, samples = played + 1, samples + segment.n_samples
        if watch is not None and (why := watch.failure(segment, record)):
            raise CheckError(f"{why}; {_fall_back(watch, segment, bench, writer, signals)}")
    return played


def _play(asked: Segment, segment: Segment, bench: Bench, writer: LogWriter, signals: Interrupts) -> Record:
    """Play what is `asked` and log of its record what the `segment` records."""
    writer.reserve(segment.n_samples)  # space is reserved before it is measured
    with signals.abortable():
        record = bench.play(asked)
    kept = {name: values for name, values in record.channels.items() if name in segment.record or not segment.record}
    with writer.segment(segment.label, segment.settings):
        writer.append(kept)
    return record


def _fall_back(watch: RunWatch, last: Segment, bench: Bench, writer: LogWriter, signals: Interrupts) -> str:
    """Bring the bench back to its last good drive and return what was done, and what to do."""
    found = watch.fallback(last)
    if found is None:
        done = "there was nothing safe to go back to, so the bench was made safe at once"
    else:
        try:
            _play(found[0], found[0], bench, writer, signals)
            done = f"the drive of cycle {found[1]} was played under feedback, then the bench was made safe"
        except MccdError as error:  # why it was stopped must still be told
            done = f"the drive of cycle {found[1]} could not be played ({error}), so the bench was made safe at once"
    return f"{done}; {writer.path} holds what was recorded; {watch.advice}"


def _identity(bench: Bench) -> dict[str, str]:
    return dataclasses.asdict(bench.identity)
