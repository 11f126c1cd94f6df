"""A first look at a file by a process of its own, for the damage that makes the HDF5 library itself crash or hang.

No check in this process can catch that: a flipped byte in an index is enough. So a log whose checksum does not
vouch for it is read once by a child with bounded memory and time, and opened here only when that came back.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from campaigns.log.checksum import read_sidecar, sha256_of
from campaigns.log.child import await_ready, bound_memory, start_python, tell_ready, time_limit_s
from campaigns.log.read import BLOCK_ROWS, Run, has_writer, open_run
from campaigns.progress import Report, unheard
from sim_backend.errors import DataError

HASHED_BYTES = 256 * 2**20  # a larger log is taken at its sidecar's word; `verify` reads it all


@dataclass(frozen=True)
class Examination:
    """What the child found: `refused` is the error at opening, `fatal` says that the library did not survive.

    `sound_rows` can be read from every channel; `damage` says what comes after, empty when nothing does.
    """

    refused: str = ""
    sound_rows: int = 0
    damage: str = ""
    fatal: bool = False


def read_run(path: str | os.PathLike[str]) -> Run:
    """Open the log at `path` for reading, even while it is written; close it or use it as a context manager.

    Raises DataError for what is no log, is damaged, differs from its checksum, or could do harm.
    """
    target = Path(path)
    if not _vouched(target):
        found = examine(target)
        if found.refused or found.fatal:
            raise DataError(found.refused or found.damage)
    return open_run(target)


def _vouched(path: Path) -> bool:
    if not path.is_file() or has_writer(path):
        return True
    promised = read_sidecar(path)
    if promised is None:
        return False
    if path.stat().st_size <= HASHED_BYTES and promised != sha256_of(path):
        raise DataError(
            f"{path} is not as it was written, its checksum differs: restore it from a copy, "
            "or save what is sound with `mccd log recover`"
        )
    return True


def examine(path: Path, report: Report = unheard) -> Examination:
    """Let a child read the whole log at `path` and return what it found."""
    try:
        limit_s = time_limit_s(path)
    except OSError as error:
        raise DataError(f"cannot read {path}: {error.strerror}; check the path and its rights") from None
    late = threading.Event()
    with start_python("from campaigns.log.probe import child; child()", str(path)) as process:
        await_ready(process, path)
        watchdog = threading.Timer(limit_s, _end, (process, late))
        watchdog.start()
        try:
            output = "".join(_heard(process, f"reading {path.name}", report))
        finally:
            watchdog.cancel()
    end = f"crashes the HDF5 library (exit {process.returncode})"
    return _judged(path, output, f"keeps the HDF5 library busy for more than {limit_s:.0f} s" if late.is_set() else end)


def _end(process: subprocess.Popen[bytes], late: threading.Event) -> None:
    late.set()
    process.kill()


def _heard(process: subprocess.Popen[bytes], what: str, report: Report) -> Iterator[str]:
    """Yield what the child says, line by line, and report how far it is."""
    assert process.stdout is not None  # start_python makes it a pipe
    total = 0
    for line in process.stdout:
        text = line.decode("utf-8", "replace")
        yield text
        try:
            said = json.loads(text)
        except ValueError:  # cut short by the end of the child
            return
        total = said.get("of", total)
        if "rows" in said and total:
            report(said["rows"], total, what)


def _judged(path: Path, output: str, end: str) -> Examination:
    sound_rows = 0
    for line in output.splitlines():
        try:
            said = json.loads(line)
        except ValueError:  # cut short by the end of the child
            break
        sound_rows = said.get("rows", sound_rows)
        if "refused" in said:
            return Examination(refused=said["refused"])
        if "damage" in said:
            return Examination(sound_rows=sound_rows, damage=said["damage"])
    message = f"{path} is damaged and {end}: restore it from a copy, or try `mccd log recover`"
    opened = '"rows"' in output
    return Examination("" if opened else message, sound_rows, message, fatal=True)


def child() -> None:
    """Read the log named on the command line and tell, line by line, how far that went."""
    bound_memory()
    tell_ready()
    try:
        with open_run(Path(sys.argv[1])) as run:
            _tell(rows=0, of=run.rows)
            _tell(damage=_read_all(run))
    except DataError as error:
        _tell(refused=str(error))


def _read_all(run: Run) -> str:
    coarse = max(BLOCK_ROWS // run.chunk_rows, 1) * run.chunk_rows
    sound = 0
    for rows in (coarse, run.chunk_rows):  # the second pass finds the chunk within the block
        try:
            for first, block in run.blocks(start=sound, rows=rows):
                sound = first + next(iter(block.values())).size
                _tell(rows=sound)
        except DataError as error:
            damage = str(error)
        else:
            return ""
    return damage


def _tell(**said: object) -> None:
    print(json.dumps(said), flush=True)
