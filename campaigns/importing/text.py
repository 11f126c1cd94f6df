"""Tables in text files: one row of cells a line, with or without names; how they are written is found (`dialect`)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO, cast

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.precision import Precision
from campaigns.importing.cells import digits_of, read_number
from campaigns.importing.dialect import (
    MAX_LINE_CHARS,
    Dialect,
    cells_of,
    dialect_of,
)
from campaigns.importing.refusals import check_expansion
from campaigns.importing.rows import Joined, Rows
from campaigns.log.guard import first_line, stored_bytes
from sim_backend.errors import ConfigError, DataError

if TYPE_CHECKING:
    import pandas as pd


class CellError(DataError):
    """A cell of a table is not a finite number; `line` counts from 1, `column` is its name or number."""

    def __init__(self, message: str, line: int, column: str, cell: str) -> None:
        super().__init__(message)
        self.line, self.column, self.cell = line, column, cell


FRAME_CELLS = 2**20
"""So many cells are parsed at once."""

KEPT_BYTES = 256 * 2**20
"""What takes more is parsed twice: to see which columns hold numbers, and then to keep these."""

PRECISION_ROWS = 1000
"""So many numbers of a column show with how many digits they are written."""

MOST_NAMES = 2**16
"""Different texts in a column of names: one that has more holds something else."""

_IN_BRACKETS = re.compile(r"[\[(]([^\[\]()]*)[\])]\s*$")


def _in_brackets(name: str) -> str:
    """Return what a name ends with in brackets, empty where it does not."""
    found = _IN_BRACKETS.search(name)
    return found[1].strip() if found else ""


@dataclass(frozen=True)
class TextSource:
    """Columns of a text table by their names; `[:, k]` selects by number. What is None is found in the file.

    Lines that begin with `#`, and what follows a blank and `#` behind the last cell, are remarks.
    """

    path: Path
    separator: str | None = None
    decimal: str | None = None
    header: bool | None = None
    known: tuple[str, ...] = ()
    """Names that must be those of columns."""

    def names(self) -> list[str]:
        """Return the names of the columns; none when the table has none."""
        return list(self.dialect.names)

    def unit(self, name: str) -> str | None:
        """Return the unit below a column's name or in brackets at its end, None where there is neither."""
        names, units = self.dialect.names, self.dialect.units
        below = units[names.index(name)] if units and name in names else ""
        inside = _in_brackets(name)
        # an index in brackets is no unit; a one is, beside other units in brackets
        units_there = {other for other in map(_in_brackets, names) if other and not other.isdecimal()}
        if inside.isdecimal() and not (inside == "1" and units_there):
            inside = ""
        return below.strip("[](){}<> ") or inside or None

    def array(self, name: str) -> NDArray[Any] | None:
        """Return a column as (n,), the whole table (n, columns) for the empty name, None without such a column.

        Raises DataError naming line and column for a cell that is not a finite number, a line with more or fewer cells
        than the others, and a name that two columns have.
        """
        columns = self._columns(name)
        if columns is None:
            return None
        return np.column_stack([self._numbers(i) for i in columns]) if name == "" else self._numbers(columns[0])

    def cells(self, name: str) -> list[str] | None:
        """Return the text of a column's cells, None without such a column; raises DataError as `array` does."""
        column = self._column(name)
        if column is None:
            return None
        return [cell.strip() for frame in self._frames(usecols=[column], dtype=str) for cell in frame.iloc[:, 0]]

    def coded(self, name: str) -> tuple[NDArray[np.int32], list[str]] | None:
        """Return every row's index (n,) in the distinct texts of a column, and these; None without such a column.

        Raises DataError as `array` does, and for more than `MOST_NAMES` different ones.
        """
        column = self._column(name)
        if column is None:
            return None
        places: dict[str, int] = {}
        codes = [np.zeros(0, np.int32)]
        for frame in self._frames(usecols=[column], dtype=str):
            found = frame.iloc[:, 0].str.strip()
            own = [places.setdefault(text, len(places)) for text in found.unique()]
            if len(places) > MOST_NAMES:
                raise DataError(
                    f"{self.path} has more than {MOST_NAMES} different texts in column '{name}': check that it "
                    "holds names"
                )
            codes.append(np.array(own, np.int32)[found.factorize()[0]])
        return np.concatenate(codes), list(places)

    def numbers(self, name: str) -> NDArray[np.float64] | None:
        """Return a column as (n,), not-a-number where a cell is none; None without such a column."""
        column = self._column(name)
        return None if column is None else np.concatenate([np.zeros(0), *self._frames_of_numbers(column)])

    def cell(self, name: str, row: int) -> str:
        """Return the text of a column's cell in a row of the data, from 0; raises DataError as `array` does."""
        columns = self._columns(name) or []
        return cells_of(self._rows.row(row)[1], self.dialect.separator)[columns[0]]

    def _frames_of_numbers(self, index: int) -> Iterator[NDArray[np.float64]]:
        """Yield a column some rows at a time, not-a-number where a cell does not hold a finite number."""
        for frame in self._frames(usecols=[index]):
            cells = frame[index]
            if cells.dtype.kind in "iuf":
                values = cells.to_numpy(np.float64)
                yield np.where(np.isfinite(values), values, np.nan)
            else:
                yield np.array([_number(str(cell), self.dialect.decimal) for cell in cells], dtype=np.float64)

    def first_cell(self, name: str) -> str | None:
        """Return the text of a column's first cell, without the rest being read; None without such a column."""
        columns = self._columns(name)
        row = next((data for _, _, data in self._rows.lines() if data is not None), None)
        return cells_of(row, self.dialect.separator)[columns[0]] if columns and row is not None else None

    def precision(self, name: str) -> Precision | None:
        """Return the most digits of a column's first PRECISION_ROWS numbers, None without such a column."""
        columns = self._columns(name)
        if not columns:
            return None
        separator, decimal = self.dialect.separator, self.dialect.decimal
        rows = (cells_of(data, separator) for _, _, data in self._rows.lines() if data is not None)
        cells = [row[i] for row in islice(rows, PRECISION_ROWS) for i in columns]
        found = [digits_of(cell, decimal) for cell in cells if read_number(cell, decimal) is not None]
        if not found:
            return None
        return Precision(digits=max(digits for digits, _ in found), whole=all(whole for _, whole in found))

    def column(self, number: int) -> str:
        """Return how the column of that number, from 0 or from the end, is asked for by `array` and `cells`.

        Raises ConfigError for a number that there is no column for.
        """
        if not -self.dialect.columns <= number < self.dialect.columns:
            raise ConfigError(
                f"{self.path} has {self.dialect.columns} columns, none of number {number}: they count from 0"
            )
        return f"\0{number % self.dialect.columns}"

    def _column(self, name: str) -> int | None:
        """Return the number of the one column of that name; None without it, and for the whole table."""
        columns = self._columns(name)
        return columns[0] if columns is not None and len(columns) == 1 else None

    def _columns(self, name: str) -> list[int] | None:
        names = self.dialect.names
        if name == "":
            return list(range(self.dialect.columns))
        if name.startswith("\0"):
            return [int(name[1:])]
        found = [i for i, own in enumerate(names) if own == name]
        if len(found) > 1:
            raise DataError(
                f"{self.path} has {len(found)} columns '{name}', columns {', '.join(str(i + 1) for i in found)}: "
                f'select one by its number, as in "[:, {found[0]}]" for column {found[0] + 1}'
            )
        return found or None

    @cached_property
    def dialect(self) -> Dialect:
        """How the table is written; raises DataError where that is not clear."""
        try:
            check_expansion(self.path, self.path.name, self.path.stat().st_size, stored_bytes(self.path))
        except OSError as error:
            raise DataError(f"cannot read {self.path}: {error.strerror}; check the path and its rights") from None
        return dialect_of(self.path, self.separator, self.decimal, self.header, self.known)

    @cached_property
    def _rows(self) -> Rows:
        return Rows(self.path, self.dialect)

    def _frames(self, **options: Any) -> Iterator[pd.DataFrame]:
        """Yield the rows some at a time, read with pandas' `options`; raises DataError where rows do not come out."""
        import pandas as pd

        dialect = self.dialect
        if dialect.doubt:
            raise DataError(dialect.doubt)
        count, remarks = self._rows.checked
        if not count:
            raise DataError(f"{self.path} has no row of data below its names: check that the file is whole")
        done = 0
        try:
            with self.path.open(encoding=dialect.encoding) as stream:
                for _ in range(dialect.first_line):
                    stream.readline(MAX_LINE_CHARS)
                with pd.read_csv(
                    cast("TextIO", Joined(data for _, _, data in self._rows.lines() if data)) if remarks else stream,
                    sep=r"\s+" if dialect.separator == " " else dialect.separator,
                    decimal=dialect.decimal,
                    header=None,
                    names=list(range(self._rows.width)),
                    nrows=count,
                    skipinitialspace=True,
                    index_col=False,
                    low_memory=False,
                    na_filter=False,  # an empty cell is reported with its position, below
                    chunksize=max(FRAME_CELLS // self._rows.width, 1),
                    **options,
                ) as frames:
                    for frame in frames:
                        done += len(frame)
                        yield frame
        except (OSError, ValueError, UnicodeError, MemoryError, OverflowError) as error:
            raise DataError(f"cannot read {self.path}: {first_line(error)}; correct the table") from None
        if done != count:
            raise DataError(f"{self.path} has {count} lines of data of which {done} rows came: check its quotes")

    @cached_property
    def _columns_of_numbers(self) -> dict[int, NDArray[Any]]:
        """Return the columns that pandas takes for numbers throughout, by their index."""
        count, kept = self._rows.checked[0], True
        kinds: dict[int, set[np.dtype[Any]]] = {i: set() for i in range(self._rows.width)}
        found: list[pd.DataFrame] = []
        for frame in self._frames():
            for i, kind in enumerate(frame.dtypes):
                kinds[i].add(kind)
            kept = kept and sum(8 * count for some in kinds.values() if _common(some) is not None) <= KEPT_BYTES
            found = [*found, frame[[i for i, some in kinds.items() if _common(some) is not None]]] if kept else []
        types = {i: kind for i, some in kinds.items() if (kind := _common(some)) is not None}
        if not types:  # asked for no column, pandas takes all lines at once
            return {}
        columns = {i: np.empty(count, kind) for i, kind in types.items()}
        done = 0
        for frame in found if kept else self._frames(usecols=list(types)):
            for i, column in columns.items():
                column[done : done + len(frame)] = frame[i].to_numpy()
            done += len(frame)
        return columns

    def _numbers(self, index: int) -> NDArray[Any]:
        values = self._columns_of_numbers.get(index)
        if values is not None:
            if values.dtype.kind == "f":
                bad = np.flatnonzero(~np.isfinite(values))
                if bad.size:
                    self._refuse_cell(index, int(bad[0]), str(values[bad[0]]), bad.size)
            return values
        # cells that pandas takes for text: numbers in another notation, or none, and then none of them is kept
        pieces: list[NDArray[np.float64]] = []
        row, count, first, kept = 0, 0, 0, True
        for numbers in self._frames_of_numbers(index):
            bad = np.flatnonzero(np.isnan(numbers))
            first = first if count or not bad.size else row + int(bad[0])
            count, row = count + bad.size, row + numbers.size
            kept = kept and not count and 8 * row <= KEPT_BYTES
            pieces = [*pieces, numbers] if kept else []
        if count:
            self._refuse_cell(index, first, self.cell(f"\0{index}", first), count)
        return np.concatenate(pieces if kept else list(self._frames_of_numbers(index)))

    def _refuse_cell(self, index: int, row: int, cell: str, count: int) -> NoReturn:
        line, _ = self._rows.row(row)
        names = self.dialect.names
        what = f"column '{names[index]}'" if index < len(names) else f"column {index + 1}"
        holds = f"holds '{cell[:40]}', which is not a finite number" if cell.strip() else "has an empty cell"
        comma = "," in cell and self.dialect.decimal == "." and read_number(cell, ",") is not None
        fix = 'say decimal = "," in [log], or repair them' if comma else "repair them, correct the delimiter"
        raise CellError(
            f"{self.path}, line {line + 1}: {what} {holds}: nan at sample {row} and {count} such cell(s) in "
            f"all; {fix} or import the stretches between them",
            line + 1,
            names[index] if index < len(names) else str(index + 1),
            cell,
        )


def _common(kinds: set[np.dtype[Any]]) -> np.dtype[Any] | None:
    """Return the type in which cells of all these types are numbers as they were written, None where some are none."""
    if not all(kind.kind in "fiub" for kind in kinds) or len({kind.kind == "b" for kind in kinds}) > 1:
        return None
    return np.result_type(*kinds) if kinds else None


def _number(cell: str, decimal: str) -> float:
    """Return the number in a cell, not-a-number where it is none."""
    found = read_number(cell.strip().strip('"'), decimal)
    return math.nan if found is None or not math.isfinite(found) else found
