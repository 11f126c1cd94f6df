"""The logs of a folder by their headers alone: what each is, or why it is none."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from campaigns.log.probe import examine, prepare
from campaigns.progress import Report, unheard
from sim_backend.errors import DataError

SUFFIX = ".h5"
UNREADABLE = "unreadable"
"""Status of a file that is not a log, or a damaged one."""


@dataclass(frozen=True)
class Listed:
    """A file of a folder as its header describes it; one that is not a sound log has only `path` and `error`.

    Times are ISO 8601 with their zone. `bench` is the public identity of the bench.
    """

    path: Path
    status: str = UNREADABLE
    status_reason: str = ""
    run_uid: str = ""
    test: str = ""
    bench: Mapping[str, str] | None = None
    seed: int | None = None
    started_utc: str = ""
    ended_utc: str = ""
    note: str = ""
    error: str = ""

    @property
    def bench_text(self) -> str:
        """The identity of the bench as one text, empty where it is not known."""
        return " ".join(text for text in (self.bench or {}).values() if text)


@dataclass(frozen=True)
class Wanted:
    """Which logs of a folder are wanted; what is empty asks for nothing.

    `test`, `bench` and `note` are parts of the texts, in capitals or not; `since` is the earliest start. A file that is
    not a sound log has none of them: it is left out by `status` alone.
    """

    test: str = ""
    bench: str = ""
    note: str = ""
    status: str = ""
    since: datetime | None = None

    def has(self, one: Listed) -> bool:
        """Tell whether this log is wanted."""
        if self.status and one.status != self.status:
            return False
        if one.error:
            return True
        texts = ((self.test, one.test), (self.bench, one.bench_text), (self.note, one.note))
        if any(part.casefold() not in text.casefold() for part, text in texts):
            return False
        return self.since is None or datetime.fromisoformat(one.started_utc) >= self.since


def list_logs(folder: Path, wanted: Wanted | None = None, report: Report = unheard) -> tuple[Listed, ...]:
    """Return the wanted logs in `folder` and below, in the order of their starts; files that are none come last.

    A process of its own reads the headers, within limits of memory and time; a file that harms it is reported as
    such, and the next one is read. Links to folders and hidden folders are not followed. Raises DataError when that
    process does not start.
    """
    found, files = [], []
    for entry in _below(folder):
        if isinstance(entry, Listed):
            found.append(entry)
        else:
            files.append(entry)
    if files:
        prepare()
    for i, path in enumerate(files):
        report(i, len(files), path.name)
        found.append(_listed(path))
    chosen = [one for one in found if wanted is None or wanted.has(one)]
    return tuple(sorted(chosen, key=_order))


def _below(folder: Path) -> Iterator[Path | Listed]:
    """Yield every file that is named as a log is, and a line for every folder that cannot be read."""
    failures: list[OSError] = []
    for home, folders, names in os.walk(folder, onerror=failures.append):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        yield from (Path(home) / name for name in _logs(names))
    for failure in failures:
        yield Listed(Path(os.fsdecode(failure.filename)), error=f"the folder cannot be read ({failure.strerror})")


def _logs(names: Sequence[str]) -> list[str]:
    return sorted(name for name in names if name.lower().endswith(SUFFIX) and not name.startswith("."))


def _listed(path: Path) -> Listed:
    if not path.is_file():
        return Listed(path, error="it is not an ordinary file")
    try:
        found = examine(path, header=True)
    except DataError as error:
        return Listed(path, error=str(error))
    if found.header is None:
        return Listed(path, error=found.refused or found.damage)
    header = dict(found.header)
    return Listed(path, **{name: header[name] for name in _KEPT})


_KEPT = ("status", "status_reason", "run_uid", "test", "bench", "seed", "started_utc", "ended_utc", "note")


def _order(one: Listed) -> tuple[bool, float, str]:
    if one.error:
        return True, 0.0, str(one.path)
    return False, datetime.fromisoformat(one.started_utc).timestamp(), str(one.path)
