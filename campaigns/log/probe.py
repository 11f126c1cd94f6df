"""A first look at a file by a process of its own, for the damage that makes the HDF5 library itself crash or hang.

No check in this process can catch that: a flipped byte in an index is enough. So a log that this process has not
written itself is looked at by a child with bounded memory and time, and opened here only when that came back. A
checksum that fits spares no look: whoever changes a file can write one.
"""

from __future__ import annotations

import atexit
import json
import os
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from campaigns.log.checksum import read_sidecar, sha256_of
from campaigns.log.child import (
    LEAST_S,
    Limited,
    ReaderFailedError,
    fork_python,
    may_fork,
    start_python,
    time_limit_s,
)
from campaigns.log.own import is_own
from campaigns.progress import Report, unheard
from sim_backend.errors import DataError

if TYPE_CHECKING:
    from campaigns.log.read import Run

HASHED_BYTES = 256 * 2**20
"""The checksum of a larger log is compared by `verify` alone, which reads it all."""

CHILD = "from campaigns.log.look import child; child()"


@dataclass(frozen=True)
class Examination:
    """What the child found: `refused` is the error at opening, `fatal` says that it did not come back.

    `sound_rows` can be read from every channel; `damage` says what comes after, empty when nothing does. `header` is
    what was asked for alone: the header by name, without the configuration.
    """

    refused: str = ""
    sound_rows: int = 0
    damage: str = ""
    fatal: bool = False
    header: Mapping[str, Any] | None = None


def read_run(path: str | os.PathLike[str]) -> Run:
    """Open the log at `path` for reading, even while it is written; close it or use it as a context manager.

    Raises DataError for what is not a log, is damaged, differs from its checksum, or could do harm.
    """
    target = Path(path)
    if not target.is_file():
        raise DataError(f"{target} is not a file: check the path")
    foreign = not is_own(target)
    if foreign:
        prepare()
    _compare(target)
    if foreign:
        found = examine(target, whole=False)
        if found.refused or found.fatal:
            raise DataError(found.refused or found.damage)
    from campaigns.log.opening import open_run

    return open_run(target)


def prepare() -> None:
    """Start the child for a log that will be read soon, if there is none, so that nobody waits for it then."""
    with _reading:
        if not _kept:
            _kept.append(_started())


def _started() -> Limited:
    """Return a new child: a copy of this process where that is safe, as it has loaded the library already."""
    if may_fork():
        from h5py import h5f

        from campaigns.log.look import child

        # a copy would take a file that is open here for open there
        if not h5f.get_obj_count(h5f.OBJ_ALL, h5f.OBJ_FILE | h5f.OBJ_DATASET | h5f.OBJ_GROUP | h5f.OBJ_ATTR):
            return Limited(fork_python(child))
    return Limited(start_python(CHILD, talk=True))


def _compare(path: Path) -> None:
    """Raise DataError for a log of usual size that differs from the checksum beside it."""
    from campaigns.log.opening import has_writer

    if has_writer(path):
        return
    promised = read_sidecar(path)
    if promised is not None and path.stat().st_size <= HASHED_BYTES and promised != sha256_of(path):
        raise DataError(
            f"{path} is not as it was written, its checksum differs: restore it from a copy, "
            "or save what is sound with `mccd log recover`"
        )


def examine(path: Path, report: Report = unheard, *, whole: bool = True, header: bool = False) -> Examination:
    """Let a child look at the log at `path`: the `whole` of its values, what could do harm, or its `header` alone.

    Raises DataError when the child does not start, is kept waiting, or has too little memory: that is not damage.
    """
    try:
        limit_s = LEAST_S if header else time_limit_s(path)
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror}; check the path and its rights") from None
    question = json.dumps({"path": str(path.absolute()), "whole": whole, "header": header})
    with _reading:
        fresh = not any(reader.ready for reader in _kept)
        found = _asked(path, limit_s, report, question)
        if found is None and not fresh:  # it had held on to what former files took
            found = _asked(path, limit_s, report, question)
    if found is None:
        raise ReaderFailedError(
            f"{path} takes more memory than its reader may: it is not said to be damaged; split it into smaller logs, "
            "or try again when more memory is free"
        )
    return found


_reading = threading.Lock()
_kept: list[Limited] = []
"""The child that looked last, if it is well: a command that opens many logs starts one process for all of them."""


def _asked(path: Path, limit_s: float, report: Report, question: str) -> Examination | None:
    """Return what the child says, None where its memory does not suffice; only one that answered is kept."""
    reader = _kept.pop() if _kept else None
    if reader is None or (reader.ready and reader.process.poll() is not None):
        reader = _started()
    said: list[dict[str, object]] = []
    try:
        reader.await_ready(path)
        with reader.within(limit_s):
            said += _heard(reader, question, report, path.name)
        found = _judged(said, reader, path)
    except BaseException:
        reader.close()
        raise
    if found is None or found.fatal:
        reader.close()
    else:
        _kept.append(reader)
    return found


def _heard(reader: Limited, question: str, report: Report, name: str) -> Iterator[dict[str, object]]:
    """Yield what the child says, line by line up to its end, and report how far it is."""
    into, out = reader.process.stdin, reader.process.stdout
    assert into is not None and out is not None  # start_python makes them pipes
    total = 0
    try:
        into.write(question.encode() + b"\n")
        into.flush()
        for line in out:
            said = json.loads(line)
            yield said
            if "of" in said:
                total = said["of"]
            elif "rows" not in said:
                return
            if total:
                report(said["rows"], total, f"reading {name}")
    except (OSError, ValueError):  # the child has ended, perhaps within a line
        return


def _judged(said: list[dict[str, object]], reader: Limited, path: Path) -> Examination | None:
    last = said[-1] if said else {}
    whole, shown = str(path.absolute()), str(path)
    sound_rows = next((int(str(one["rows"])) for one in reversed(said) if "rows" in one), 0)
    if "memory" in last:
        return None
    if "refused" in last:
        return Examination(refused=str(last["refused"]).replace(whole, shown))
    if "header" in last:
        return Examination(header=cast(Mapping[str, Any], last["header"]))
    if "damage" in last:
        return Examination(sound_rows=sound_rows, damage=str(last["damage"]).replace(whole, shown))
    error = reader.why(path)
    if isinstance(error, ReaderFailedError):
        raise error
    message = f"{error}, or try `mccd log recover`"
    return Examination("" if sound_rows else message, sound_rows, message, fatal=True)


@atexit.register
def _end() -> None:
    while _kept:
        _kept.pop().close()


def _forget() -> None:
    """In a forked copy of this process: the child is the other's, and the lock may be held for good."""
    global _reading
    _kept.clear()
    _reading = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget)
