"""The rows of a text table: its lines, counted and checked in blocks; one that is not as the others is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import NoReturn

import numpy as np

from campaigns.importing.dialect import Dialect, blocks_of, cells_of, lines_of, without_remark
from campaigns.log.guard import first_line
from sim_backend.errors import DataError

_BLANK = np.array([chr(code).isspace() for code in range(128)])
"""Which of the characters of ASCII are blanks."""


@dataclass(frozen=True)
class Rows:
    """The rows of the table at `path`, which is written as `dialect` says; all raise DataError where it is not."""

    path: Path
    dialect: Dialect

    def lines(self) -> Iterator[tuple[int, str, str | None]]:
        """Give the number of every line of the data, the line, and what of it is data: None for a remark.

        Raises DataError for the first line that has another number of cells, and for an empty one before data.
        """
        blanks: list[int] = []
        for first, block in self._blocks():
            yield from self._lines_of(first, block, blanks)

    def _lines_of(self, first: int, block: str, blanks: list[int]) -> Iterator[tuple[int, str, str | None]]:
        """Give the lines of one block as `lines` does; `blanks` are the numbers of the empty lines until here."""
        for number, line in enumerate(block.removesuffix("\n").split("\n"), first):
            if not line.strip():
                blanks.append(number)
                continue
            data = without_remark(line, self.dialect.separator, self.width) if "#" in line else line
            if data.count('"') % 2:
                raise DataError(f"{self.path}, line {number + 1} has a quote that does not end in its line: repair it")
            more = self.dialect.trailing and not data.rstrip().endswith(self.dialect.separator)
            if more or self._count(data) != self.width:
                if line.lstrip().startswith("#"):
                    yield number, line, None
                    continue
                self._refuse_width(number, data)
            if blanks:
                raise DataError(
                    f"{self.path}, line {blanks[0] + 1} is empty and data follow: take it out if no row is lost there; "
                    "otherwise import the stretches between such lines as [[parts]]"
                )
            yield number, line, data

    @cached_property
    def checked(self) -> tuple[int, bool]:
        """Return how many rows there are, and whether remarks are among them."""
        count, remarks, blanks = 0, False, list[int]()
        for first, block in self._blocks():
            plain = None if blanks else self._plain_rows(block)
            if plain is not None:
                count += plain
                continue
            for _, line, data in self._lines_of(first, block, blanks):
                remarks = remarks or data is not line
                count += data is not None
        return count, remarks

    def _plain_rows(self, block: str) -> int | None:
        """Return how many lines a block has when all of them are rows, None when each has to be looked at.

        Looked at one by one, the lines of a large table take longer than all the rest of its import.
        """
        separator = self.dialect.separator
        if separator == " " or self.dialect.trailing or '"' in block or "#" in block or not block.isascii():
            return None
        text = np.frombuffer(block.encode("ascii"), np.uint8)
        ends = np.flatnonzero(text == ord("\n"))
        starts = np.concatenate([[0], ends + 1])[: ends.size + (not block.endswith("\n"))]
        separators = np.add.reduceat(text == ord(separator), starts, dtype=np.int64)
        filled = np.logical_or.reduceat(~_BLANK[text], starts)
        return starts.size if filled.all() and (separators == self.width - 1).all() else None

    def row(self, row: int) -> tuple[int, str]:
        """Return the number of the line that holds a row of the data, from 0, and what of it is data."""
        blanks: list[int] = []
        for first, block in self._blocks():
            plain = self._plain_rows(block)
            if plain is not None and plain <= row:
                row -= plain
                continue
            for number, _, data in self._lines_of(first, block, blanks):
                if data is not None:
                    row -= 1
                    if row < 0:
                        return number, data
        raise DataError(f"{self.path} has no row {row} more of data: it was changed while it was read")

    @property
    def width(self) -> int:
        """How many cells a line has."""
        return self.dialect.columns + self.dialect.trailing

    def _count(self, line: str) -> int:
        if '"' not in line and self.dialect.separator != " ":
            return line.count(self.dialect.separator) + 1
        return len(cells_of(line, self.dialect.separator))

    def _refuse_width(self, number: int, line: str) -> NoReturn:
        raise DataError(
            f"{self.path}, line {number + 1} has {self._count(line)} cells, the others have {self.width} "
            f"('{line[:60]}'): complete it, or take it out and import the stretches around it as [[parts]]"
        )

    def _blocks(self) -> Iterator[tuple[int, str]]:
        """Give the blocks of whole lines from the first of the data on, each with the number, from 0, of its first."""
        try:
            with self.path.open(encoding=self.dialect.encoding) as stream:
                number = sum(1 for _ in islice(lines_of(stream, self.path), self.dialect.first_line))
                for block in blocks_of(stream, self.path):
                    yield number, block
                    number += block.count("\n")
        except (OSError, UnicodeError) as error:
            raise DataError(f"cannot read {self.path}: {first_line(error)}; save it as UTF-8 text") from None


class Joined:
    """Lines as a file that is read, so that they are never in memory together."""

    def __init__(self, lines: Iterator[str]) -> None:
        self._lines = lines
        self._left = ""

    def __iter__(self) -> Iterator[str]:
        return (f"{line}\n" for line in self._lines)

    def read(self, size: int = -1) -> str:
        """Return at most `size` characters."""
        parts, count = [self._left], len(self._left)
        for line in self._lines:
            parts.append(f"{line}\n")
            count += len(line) + 1
            if 0 <= size <= count:
                break
        whole = "".join(parts)
        self._left = whole[size:] if size >= 0 else ""
        return whole[:size] if size >= 0 else whole
