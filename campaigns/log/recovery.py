"""Recovery: what a crash or a damage left of a log, saved into a new file; the old one is not touched."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from campaigns.log.opening import open_run
from campaigns.log.probe import examine
from campaigns.log.read import Run
from campaigns.log.schema import LogSegment, to_json
from campaigns.log.whole import whole_log
from campaigns.log.write import SETTINGS_BYTES
from campaigns.progress import Report, part_of, unheard
from sim_backend.errors import DataError


@dataclass(frozen=True)
class Recovery:
    """What was saved: `rows` of the `committed_rows` that the damaged log had counted, and why no more."""

    path: Path
    rows: int
    committed_rows: int
    reason: str


def recover(path: str | os.PathLike[str], target: str | os.PathLike[str], report: Report = unheard) -> Recovery:
    """Copy the sound committed samples of the log at `path`, up to the first damage, into a new log at `target`.

    The copy keeps the run's uid and description and gets status `crashed` with the reason. Raises DataError
    when the log cannot be opened at all or holds no sound sample, ConfigError when `target` exists.
    """
    found = examine(Path(path), part_of(report, 0.0, 0.5))
    if found.refused:
        raise DataError(found.refused)
    rows, damage = found.sound_rows, found.damage
    with open_run(Path(path)) as run:
        if not rows:
            raise DataError(f"{path} holds no sound sample of {run.rows} committed: repeat the run; {damage}")
        reason = f"recovered {rows} of {run.rows} committed samples of a run that was {run.status}"
        reason += f"; {damage}" if damage else ""
        segments = [
            LogSegment(part.label, part.start, min(part.stop, rows), part.settings)
            for part in run.segments
            if part.start < rows
        ]
        _copy(run, rows, segments, Path(target), reason[:1000], part_of(report, 0.5, 1.0))
    return Recovery(Path(target), rows, run.rows, reason)


def _copy(run: Run, rows: int, segments: list[LogSegment], target: Path, reason: str, report: Report) -> None:
    def append(start: int, stop: int) -> None:
        for first, block in run.blocks(start=start, stop=stop):
            log.append(block)
            report(first, rows, "copying")

    header = run.header
    widest = max((len(to_json(part.settings, part.label).encode()) for part in segments), default=0)
    with whole_log(
        target,
        list(run.channels.values()),
        test=header.test,
        bench=header.bench,
        configuration=header.configuration,
        seed=header.seed,
        run_uid=header.run_uid,
        started_utc=header.started_utc,
        tool_version=header.tool_version,
        tool_commit=header.tool_commit,
        chunk_rows=min(run.chunk_rows, 2**20),
        settings_bytes=max(widest, SETTINGS_BYTES),
        note=header.note,
    ) as log:
        done = 0
        for part in segments:
            append(done, part.start)
            with log.segment(part.label, part.settings):
                append(part.start, part.stop)
            done = part.stop
        append(done, rows)
        log.set_status("crashed", reason)
