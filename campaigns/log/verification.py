"""Verification of a log: is every bit as it was written, and does the file keep what the schema promises?"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from campaigns.log.checksum import read_sidecar, sha256_of, sidecar_of
from campaigns.log.opening import open_run
from campaigns.log.probe import Examination, examine
from campaigns.log.read import Run
from campaigns.log.schema import OPEN_STATUS
from campaigns.progress import Report, part_of, unheard
from sim_backend.errors import DataError

HASHING = 0.3
"""Share of the time that the checksum takes; unpacking every chunk takes the rest."""


@dataclass(frozen=True)
class Check:
    """One thing that was looked at: its name, whether it holds, and what was found."""

    name: str
    ok: bool
    detail: str


@dataclass(frozen=True)
class VerifyReport:
    """All checks of one file, and its SHA-256 as it is now."""

    path: Path
    sha256: str
    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """Whether every check holds."""
        return all(check.ok for check in self.checks)


def verify(path: str | os.PathLike[str], report: Report = unheard) -> VerifyReport:
    """Check the log at `path` against its checksum, its schema, its counter and the checksums of its chunks.

    A file with any flaw gives a report that is not ok; raises DataError only when nothing can be read.
    """
    target = Path(path)
    digest = sha256_of(target, part_of(report, 0.0, HASHING))
    found = examine(target, part_of(report, HASHING, 1.0))
    if found.refused:
        unreadable = Check("schema", False, found.refused)
        return VerifyReport(target, digest, (_checksum(target, digest, ""), unreadable))
    with open_run(target) as run:
        checks = (
            _checksum(target, digest, run.status),
            Check("schema", True, f"{len(run.channels)} channels, {len(run.segments)} segments"),
            _status(run),
            _counter(run),
            _chunks(run, found),
        )
    return VerifyReport(target, digest, checks)


def _checksum(path: Path, digest: str, status: str) -> Check:
    try:
        promised = read_sidecar(path)
    except DataError as error:
        return Check("checksum", False, str(error))
    if promised is None:
        pending = status == OPEN_STATUS
        detail = "none yet, the run is being written" if pending else f"{sidecar_of(path).name} is missing"
        return Check("checksum", pending, detail)
    if promised != digest:
        return Check("checksum", False, f"SHA-256 is {digest[:16]}…, written was {promised[:16]}…")
    return Check("checksum", True, f"SHA-256 {digest[:16]}… as written")


def _status(run: Run) -> Check:
    crashed = run.status == "crashed"
    reason = f": {run.header.status_reason}" if run.header.status_reason else ""
    return Check("status", not crashed or run.header.ended_utc != "", run.status + reason)


def _counter(run: Run) -> Check:
    extra = run.stored_rows - run.rows
    if extra and run.status != OPEN_STATUS:
        return Check("counter", False, f"{run.rows} samples committed, {extra} more stored without commitment")
    return Check("counter", True, f"{run.rows} samples committed")


def _chunks(run: Run, found: Examination) -> Check:
    if found.damage:
        return Check("chunks", False, f"readable up to sample {found.sound_rows}: {found.damage}")
    return Check("chunks", True, f"{len(run.channels)} channels of {run.rows} samples are readable")
