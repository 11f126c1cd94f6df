"""The trials of a study on disk: one SQLite file, in which a trial is whole or absent, whatever ends the program.

Every batch of finished trials is one transaction that is on the disk before anybody hears of it (write-ahead log,
synchronous=FULL). The file is held exclusively while it is open, so that two programs never write one study.
"""

from __future__ import annotations

import json
import math
import os
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Self

import numpy as np
from numpy.typing import NDArray

from analysis.study.fingerprint import require_same
from analysis.study.kinds import Column, Scalar
from analysis.study.trial import Outcome
from sim_backend.documents import json_of
from sim_backend.errors import ConfigError, DataError
from sim_backend.safe_write import require_no_link
from sim_backend.small_files import open_regular

FILE = "trials.sqlite"
SCHEMA = "mccd-study-trials/1"
_OWN = ("trial", "status", "reason", "wall_s")
_TYPES = {"number": "REAL", "flag": "INTEGER", "text": "TEXT"}
_KEPT_AS = {"number": "'real', 'null'", "flag": "'integer', 'null'", "text": "'text', 'null'"}
_STUDY = "CREATE TABLE study (part TEXT PRIMARY KEY, value TEXT NOT NULL)"
_LONGEST_BYTES = 2**26
"""No text of a store comes near this size; SQLite refuses a longer one before it is made."""

_RESTORE = "restore it from a copy, or begin anew with another --out"


class Store:
    """The finished trials in a folder; use as a context manager.

    `varied` and `columns` name what stands beside each trial. Raises ConfigError for the folder of another study, or of
    this one without `resume`, or one that another program holds; DataError where the disk or the file fails.
    """

    def __init__(
        self, folder: Path, parts: dict[str, str], varied: Sequence[str], columns: Sequence[Column], *, resume: bool
    ) -> None:
        self.path = folder / FILE
        self._varied, self._columns = tuple(varied), tuple(columns)
        folder.mkdir(parents=True, exist_ok=True)
        require_no_link(self.path)  # SQLite itself refuses links where it keeps the files beside it
        existed = self.path.exists()
        if existed and not resume:
            raise ConfigError(f"{folder} holds trials already; go on with --resume, or choose another --out")
        journal = folder / f"{FILE}-journal"
        if journal.exists() and journal.lstat().st_size:  # SQLite would play it back, and delete a file that it names
            raise DataError(
                f"{journal} is not a file of a study, which keeps a write-ahead log; delete it, or choose another --out"
            )
        try:
            # the store, and what SQLite keeps beside it, is opened by SQLite, which asks for no kind of file
            for name in (FILE, f"{FILE}-wal", f"{FILE}-shm", f"{FILE}-journal"):
                if (folder / name).exists():
                    os.close(open_regular(folder / name))
        except OSError as error:
            raise DataError(f"{error.filename}: {error.strerror}; delete it, or choose another --out") from None
        try:
            self._file = sqlite3.connect(self.path, timeout=0.0, isolation_level=None, check_same_thread=True)
        except sqlite3.Error as error:
            raise DataError(f"{self.path}: {error}; check the folder, its rights and the free space") from None
        try:
            with _clear_errors(self.path):
                self._hold()
                self._claim(parts)
        except BaseException:
            self._file.close()
            raise

    def _hold(self) -> None:
        """Lock the file for this program and check that it can hold trials."""
        self._file.execute("PRAGMA locking_mode=EXCLUSIVE")
        self._file.execute("PRAGMA synchronous=FULL")
        (mode,) = self._file.execute("PRAGMA journal_mode=WAL").fetchone()
        if mode != "wal":  # SQLite says what it has instead of failing
            raise DataError(
                f"{self.path}: its disk allows no write-ahead log (SQLite offers '{mode}'); choose an --out on another"
            )
        self._file.execute("BEGIN IMMEDIATE")  # an exclusive connection keeps what this locks until it is closed
        self._file.execute("COMMIT")

    def _claim(self, parts: dict[str, str]) -> None:
        self._file.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _LONGEST_BYTES)
        tables = self._tables()
        if "study" not in tables:
            return self._begin(parts)
        found = dict(self._file.execute("SELECT CAST(part AS TEXT), CAST(value AS TEXT) FROM study").fetchall())
        if found.get("schema") != SCHEMA:
            raise DataError(f"{self.path}: its schema is {found.get('schema')}, not {SCHEMA}; choose another --out")
        before = json_of(found.get("fingerprint", ""), str(self.path), error=DataError, fix=_RESTORE)
        if not isinstance(before, dict):
            raise DataError(f"{self.path}: it does not say which study it is of; {_RESTORE}")
        fix = "go on with the study and the programs as they were, or begin anew with another --out"
        require_same(before, parts, str(self.path), fix)
        if tables.get("trials") != self._trials_as_made():
            self._refuse_columns()
        (sound,) = self._file.execute("PRAGMA quick_check(1)").fetchone()
        if sound != "ok":
            raise DataError(f"{self.path} is damaged ({sound}); {_RESTORE}")
        self._require_trials()

    def _tables(self) -> dict[str, str]:
        """Return how each table was made; raises DataError for a file that holds anything but plain tables of ours.

        A view, a trigger or an expression in a table is a program, which may run without end as soon as it is read.
        """
        made = {}
        for kind, name, statement in self._file.execute("SELECT type, name, sql FROM sqlite_master"):
            if kind == "table" and (name == "trials" or (name == "study" and statement == _STUDY)):
                made[name] = str(statement)
            elif statement is not None:  # the index that SQLite keeps for a primary key has none
                raise DataError(
                    f"{self.path} holds the {str(kind)[:40]} '{str(name)[:40]}' in another format than any study; "
                    f"{_RESTORE}"
                )
        return made

    def _refuse_columns(self) -> NoReturn:
        wanted = [*_OWN, *self._varied, *(column.name for column in self._columns)]
        there = [str(name) for _, name, *_ in self._file.execute("PRAGMA table_info(trials)")]
        raise DataError(
            f"{self.path}: its trials have the columns {', '.join(there)[:1000]}, not {', '.join(wanted)}, or in "
            f"another format; {_RESTORE}"
        )

    def _require_trials(self) -> None:
        """Raise DataError unless the trials have the column types of this program."""
        kept = {"trial": "'integer'", "status": "'text'", "reason": "'text'", "wall_s": "'real'"}
        kept |= {column.name: _KEPT_AS[column.kind] for column in self._columns}
        wrong = " OR ".join(f"typeof({_quoted(name)}) NOT IN ({kinds})" for name, kinds in kept.items())
        query = f"SELECT trial FROM trials WHERE trial < 0 OR {wrong} LIMIT 1"
        if (found := self._file.execute(query).fetchone()) is not None:
            raise DataError(f"{self.path}: trial {found[0]} holds what no trial is kept as; {_RESTORE}")

    def _begin(self, parts: dict[str, str]) -> None:
        """Make the tables and bind them to the study, in one step: a kill leaves both or neither."""
        with self._file:
            self._file.execute("BEGIN")
            self._file.execute(_STUDY)
            self._file.execute(self._trials_as_made())
            rows = [("schema", SCHEMA), ("fingerprint", json.dumps(parts))]
            self._file.executemany("INSERT INTO study VALUES (?, ?)", rows)

    def _trials_as_made(self) -> str:
        columns = ["trial INTEGER PRIMARY KEY", "status TEXT NOT NULL", "reason TEXT NOT NULL", "wall_s REAL NOT NULL"]
        columns += [_quoted(name) for name in self._varied]
        columns += [f"{_quoted(c.name)} {_TYPES[c.kind]}" for c in self._columns]
        return f"CREATE TABLE trials ({', '.join(columns)})"

    def add(self, outcomes: Sequence[Outcome]) -> None:
        """Keep finished trials: when this returns they are on the disk. Raises DataError when they cannot be."""
        marks = ", ".join("?" * (len(_OWN) + len(self._varied) + len(self._columns)))
        rows = [(o.trial, o.status, o.reason, o.wall_s, *map(_stored, o.varied + o.results)) for o in outcomes]
        with _clear_errors(self.path), self._file:
            self._file.execute("BEGIN")
            self._file.executemany(f"INSERT INTO trials VALUES ({marks})", rows)

    def finished(self, total: int) -> NDArray[np.bool_]:
        """Return which of the first `total` trials are there, shape (total,)."""
        there = np.zeros(total, dtype=bool)
        with _clear_errors(self.path):
            for (trial,) in self._file.execute("SELECT trial FROM trials WHERE trial < ?", (total,)):
                there[trial] = True
        return there

    def statuses(self, total: int) -> list[str]:
        """Return the status of each of the first `total` trials, empty for one that is not there."""
        out = [""] * total
        with _clear_errors(self.path):
            for trial, status in self._file.execute("SELECT trial, status FROM trials WHERE trial < ?", (total,)):
                out[trial] = status
        return out

    def numbers(self, name: str, total: int) -> NDArray[np.float64]:
        """Return a column of the first `total` trials, shape (total,); not a number where there is none."""
        out = np.full(total, math.nan)
        query = f"SELECT trial, {_quoted(name)} FROM trials WHERE trial < ?"
        with _clear_errors(self.path):
            for trial, value in self._file.execute(query, (total,)):
                if value is not None:
                    out[trial] = value
        return out

    def texts(self, name: str, total: int) -> list[str]:
        """Return a column of texts of the first `total` trials, empty where there is none."""
        out = [""] * total
        query = f"SELECT trial, {_quoted(name)} FROM trials WHERE trial < ?"
        with _clear_errors(self.path):
            for trial, value in self._file.execute(query, (total,)):
                out[trial] = "" if value is None else value
        return out

    def reasons(self, total: int) -> list[tuple[str, str, int, int]]:
        """Return status, reason, count and first trial of all that came to nothing, the most frequent first."""
        query = (
            "SELECT status, reason, COUNT(*), MIN(trial) FROM trials WHERE status != 'done' AND trial < ? "
            "GROUP BY status, reason ORDER BY COUNT(*) DESC, MIN(trial)"
        )
        with _clear_errors(self.path):
            return self._file.execute(query, (total,)).fetchall()

    def rows(self, total: int) -> Iterator[tuple[Any, ...]]:
        """Yield trial, status, reason, what varied and the results, in the order of the trials."""
        names = [*_OWN[:3], *map(_quoted, self._varied), *(_quoted(c.name) for c in self._columns)]
        with _clear_errors(self.path):
            yield from self._file.execute(
                f"SELECT {', '.join(names)} FROM trials WHERE trial < ? ORDER BY trial", (total,)
            )

    def seconds(self, total: int) -> float:
        """Return the time that the first `total` trials took, all together."""
        with _clear_errors(self.path):
            (seconds,) = self._file.execute("SELECT TOTAL(wall_s) FROM trials WHERE trial < ?", (total,)).fetchone()
        return float(seconds)

    def close(self) -> None:
        """Close the file; what was added stays."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class _clear_errors:  # noqa: N801  (used like a function)
    """Turn what SQLite raises into the project's errors."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> None:
        pass

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if isinstance(error, sqlite3.OperationalError) and "locked" in str(error):
            raise ConfigError(f"{self._path}: another mccd is running this study; wait for it to end") from None
        if isinstance(error, sqlite3.Error):
            fix = "check the folder, its rights and the free space; what was saved before is untouched"
            raise DataError(f"{self._path}: {error}; {fix}") from None


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _stored(value: Scalar) -> float | int | str | None:
    """Return a value as SQLite keeps it: flags as 0 and 1, nothing for what is not a number.

    Numbers come back to the last bit, only that minus zero comes back as zero.
    """
    if isinstance(value, bool):
        return int(value)
    return None if isinstance(value, float) and math.isnan(value) else value
