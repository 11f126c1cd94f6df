"""How a text table is written: its encoding, what separates cells, the decimal sign, and where its data begin.

Everything is found from the file alone and must hold for all of it; what could be read in two ways is refused with the
key of the map that decides.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TextIO

from campaigns.importing.cells import DATE, fits, is_number, read_number
from campaigns.importing.doubts import check_no_units, comma_doubt, may_be_names
from campaigns.log.guard import first_line
from campaigns.spreadsheet import as_named
from sim_backend.errors import DataError

SEPARATORS = ("\t", ";", ",", "|", " ")
"""What may stand between cells, " " for any run of blanks; of equally good ones the first is taken."""

COMMENT = ("#", "%", "//", "!")
"""What begins a line of remarks above the data; inside the data `#` alone does."""

WORD = 0.25
"""Worth of a cell of one word in the search for the separator, against that of a number."""

_SAMPLE_LINES = 400
MAX_LINE_CHARS = 2**20
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_BRACKETED = re.compile(r"[\[(<].*[\])>]")
_NAME_AND_UNIT = re.compile(r"\S+(?: [\[(<][^\])>]*[\])>])?")


@dataclass(frozen=True)
class Dialect:
    """How one table is written; `names` and `units` are empty where it has none, lines count from 0."""

    encoding: str
    separator: str
    decimal: str
    columns: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    first_line: int
    trailing: bool
    """Whether every row ends with a separator, after which there is no cell."""
    doubt: str
    """Why its numbers cannot be read for certain; empty where they can."""


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line without the blanks around them; quotes hold a cell together."""
    if '"' in line:
        blank = separator == " "
        try:
            row = next(csv.reader([line.strip() if blank else line], delimiter=separator, skipinitialspace=True), [])
        except csv.Error as error:
            raise DataError(
                f"a line begins '{line[:40]}' and is not a row of cells ({error}): check the file"
            ) from None
        return [cell.strip() for cell in row if cell or not blank]
    return line.split() if separator == " " else [cell.strip() for cell in line.split(separator)]


def is_remark(line: str) -> bool:
    """Tell whether a line above the data is a remark."""
    return line.lstrip().startswith(COMMENT)


def without_remark(line: str, separator: str, columns: int) -> str:
    """Return a line of data without a remark at its end, which begins with a blank and `#` after the last cell."""
    found = re.search(r"\s#", line)
    if found and len(cells_of(line[: found.start()], separator)) == columns:
        return line[: found.start()]
    return line


def encoding_of(path: Path) -> str:
    """Return how the text at `path` is encoded; raises DataError when it cannot be read or is not text."""
    try:
        with path.open("rb") as stream:
            start = stream.read(4)
            if start[:2] in (b"\xff\xfe", b"\xfe\xff"):
                return "utf-16"
            stream.seek(0)
            plain = True
            while block := stream.read(2**22):
                if b"\0" in block:
                    raise DataError(f"{path} holds zero bytes and is not text: save it as UTF-8 text")
                plain = plain and block.isascii()
        if plain:
            return "ascii"
        with path.open(encoding="utf-8-sig") as text:
            while text.read(2**22):
                pass
    except UnicodeDecodeError:
        return "cp1252"  # numbers are ASCII in both: names and units alone can differ
    except OSError as error:
        raise DataError(f"cannot read {path}: {first_line(error)}; check the file") from None
    return "utf-8-sig"


def dialect_of(
    path: Path, separator: str | None, decimal: str | None, header: bool | None, known: Sequence[str] = ()
) -> Dialect:
    """Return how the table at `path` is written; what the map says is taken as said.

    The line with the `known` names is that of the names, whatever the rows below it hold.

    Raises DataError where the table has no rows of numbers, or can be read in more than one way.
    """
    encoding = encoding_of(path)
    lines = _sample(path, encoding)
    if not any(line.strip() and not is_remark(line) for line in lines):
        raise DataError(f"{path} holds no line of data: check that it is the right file")
    named = separator is not None
    sure = _line_with(known, lines, [separator] if separator else SEPARATORS) if known else None
    separator = separator or (sure[0] if sure else _separator(lines, decimal))
    rows = [cells_of(line, separator) for line in lines]
    plain = [row for row, line in zip(rows, lines, strict=True) if line.strip() and not is_remark(line)]
    columns = _columns(plain)
    # a remark at the end of a line of data is no part of its last cell
    lines = [line if is_remark(line) else without_remark(line, separator, columns) for line in lines]
    rows = [cells_of(line, separator) for line in lines]
    plain = [row for row, line in zip(rows, lines, strict=True) if line.strip() and not is_remark(line)]
    decimal_named = decimal is not None
    decimal = decimal or _decimal(plain, columns, separator, path)
    first = sure[1] + 1 if sure else _first_row(lines, rows, columns, decimal, path)
    trailing = columns > 1 and separator != " " and all(not r[-1] for r in rows[first:] if len(r) == columns)
    # a last column that has a name is one, empty as it may be
    trailing = trailing and not any(len(row) == columns and row[-1] for row in rows[:first])
    heads: tuple[tuple[str, ...], tuple[str, ...], int]
    if sure:
        heads = tuple(_without_end(_bare(lines[sure[1]], separator), columns - trailing)), (), first
    else:
        heads = _head(path, lines, rows, first, columns - trailing, separator, decimal, header)
    names, units, first = tuple(map(as_named, heads[0])), *heads[1:]
    full = [row for row in rows[first:] if len(row) == columns]
    doubt = "" if named and decimal_named else comma_doubt(path, full, separator, names)
    return Dialect(encoding, separator, decimal, columns - trailing, names, units, first, trailing, doubt)


def _sample(path: Path, encoding: str) -> list[str]:
    try:
        with path.open(encoding=encoding) as stream:
            lines = list(islice(lines_of(stream, path), _SAMPLE_LINES))
    except (OSError, UnicodeError) as error:
        raise DataError(f"cannot read {path}: {first_line(error)}; save it as UTF-8 text") from None
    return [line.rstrip("\r\n") for line in lines]


def lines_of(stream: TextIO, path: Path) -> Iterator[str]:
    """Yield the lines of a text; raises DataError for one so long that it is none of a table, before it is held."""
    while line := stream.readline(MAX_LINE_CHARS):
        if len(line) == MAX_LINE_CHARS:
            raise _too_long(path)
        yield line


def blocks_of(stream: TextIO, path: Path) -> Iterator[str]:
    """Yield a text in blocks of whole lines; raises DataError as `lines_of` does."""
    while block := stream.read(MAX_LINE_CHARS):
        if not block.endswith("\n"):
            block += stream.readline(MAX_LINE_CHARS)
        # the lines before the last are shorter than the block that was read
        if len(block) - (block.rfind("\n", 0, len(block) - 1) + 1) >= MAX_LINE_CHARS:
            raise _too_long(path)
        yield block


def _too_long(path: Path) -> DataError:
    return DataError(f"{path} has a line of more than {MAX_LINE_CHARS} characters: check that it is a table")


def _separator(lines: Sequence[str], decimal: str | None) -> str:
    """Return the separator by which the most cells of the most rows are numbers, dates, or at least single words."""
    plain = [line for line in lines if line.strip() and not is_remark(line)]
    best, most = ",", 0.0
    for separator in SEPARATORS:
        rows = [cells_of(line, separator) for line in plain]
        columns = _columns(rows)
        full = [row for row in rows if len(row) == columns]
        if columns < 2:
            continue
        score = sum(sum(_worth(c, decimal) for c in row) / columns for row in full)
        if score > most + 1e-9:
            best, most = separator, score
    return best


def _worth(cell: str, decimal: str | None) -> float:
    """Return how much a cell speaks for the separator that cut it out: nothing where another is left in it."""
    if is_number(cell, decimal) or DATE.fullmatch(cell):
        return 1.0
    return WORD if cell and not any(separator in cell for separator in SEPARATORS) else 0.0


def _columns(rows: Sequence[Sequence[str]]) -> int:
    """Return how many cells most rows have; of the last rows where two numbers are equally frequent."""
    counted = Counter(len(row) for row in reversed(rows))
    return counted.most_common(1)[0][0]


def _decimal(rows: Sequence[Sequence[str]], columns: int, separator: str, path: Path) -> str:
    """Return the decimal sign of the cells; raises DataError where a comma may as well set off thousands."""
    cells = [cell for row in rows if len(row) == columns for cell in row]
    commas = [c for c in cells if "," in c and read_number(c, ",") is not None]
    if not commas or any("." in c and read_number(c, ".") is not None for c in cells):
        return "."
    if all(_THOUSANDS.fullmatch(c) for c in commas):
        raise DataError(
            f"{path}: '{commas[0]}' is one number with a decimal comma and another with thousands set off: "
            'say decimal = "," in [log], or take the commas out'
        )
    return ","


def _first_row(lines: Sequence[str], rows: Sequence[Sequence[str]], columns: int, decimal: str, path: Path) -> int:
    """Return the number of the first line of data."""
    full = [row for row, line in zip(rows, lines, strict=True) if len(row) == columns and not is_remark(line)]
    shares = [sum(fits(row[i], decimal) for row in full) / len(full) for i in range(columns)]
    numbers = [any(read_number(row[i], decimal) is not None for row in full) for i in range(columns)]
    numeric = [i for i in range(columns) if shares[i] >= 0.5 and numbers[i]]
    if not numeric:
        # one row of numbers below one of names, or cells that are no numbers
        numeric = [i for i in range(columns) if read_number(full[-1][i], decimal) is not None]
    if not numeric:
        raise DataError(
            f"{path} is empty: no column holds numbers (the last line read is '{lines[-1][:60]}'); check the file"
        )
    for k, (row, line) in enumerate(zip(rows, lines, strict=True)):
        if len(row) != columns or is_remark(line):
            continue
        cells = [row[i] for i in numeric]
        known = [read_number(cell, decimal) is not None for cell in cells]
        if any(known) and all(fits(cell, decimal) for cell in cells):
            return k
    raise DataError(f"{path} holds no row of numbers: check that it is the right file")


def _line_with(known: Sequence[str], lines: Sequence[str], separators: Sequence[str]) -> tuple[str, int] | None:
    """Return by which separator a line has all the known names, and its number; None where none has."""
    for separator in separators:
        for k, line in enumerate(lines):
            if set(known) <= set(map(as_named, _bare(line, separator))):
                return separator, k
    return None


def _head(
    path: Path,
    lines: Sequence[str],
    rows: Sequence[Sequence[str]],
    first: int,
    columns: int,
    separator: str,
    decimal: str,
    header: bool | None,
) -> tuple[tuple[str, ...], tuple[str, ...], int]:
    """Return names, units and the number of the first line of data, of which the first may be names."""
    above = [_bare(lines[k], separator, columns) for k in range(first) if lines[k].strip()]
    remarks = [is_remark(lines[k]) for k in range(first) if lines[k].strip()]
    data = [list(row[:columns]) for row in rows[first : first + 50] if len(row) >= columns]
    # where names can be the first row alone: a title above it has other cells than it
    bare = all(remark or (columns > 1 and len(line) != columns) for line, remark in zip(above, remarks, strict=True))
    if header is True and bare:
        return tuple(data[0]), (), first + 1
    if header is not False and bare and not any(remarks) and may_be_names(path, data[0], data[1:], decimal):
        return tuple(data[0]), (), first + 1
    if header is False or not above:
        if header:
            raise DataError(f"{path} has no line of names above its data: take header = true out of the map")
        return (), (), first
    # remarks between names and data are no names
    while remarks and remarks[-1] and len(above[-1]) not in (columns, columns + 1) and len(above) > 1:
        above.pop()
        remarks.pop()
    last, others = _without_end(above[-1], columns), [_without_end(line, columns) for line in above[:-1]]
    if len(last) == columns:
        if _are_units(last) and others and len(others[-1]) == columns and not _are_units(others[-1]):
            return _names(path, others[-1], first - 1, header), tuple(last), first
        check_no_units(path, data[0], data[1:], decimal)
        return _names(path, last, first, header), (), first
    if remarks[-1] or len(last) == 1:
        return (), (), first  # a remark or a line of text
    raise DataError(
        f"{path}, line {first}: {len(last)} names over {columns} cells: is the decimal sign a comma, or the delimiter "
        f"another than {separator!r}? Give each column one name, or say delimiter and decimal in [log]"
    )


def _names(path: Path, cells: Sequence[str], line: int, header: bool | None) -> tuple[str, ...]:
    """Return a line above the data as names; raises DataError where it may be a row that cannot be read."""
    number = next((cell for cell in cells if read_number(cell, ".") is not None), None)
    if number is not None and not header:
        raise DataError(
            f"{path}, line {line}: '{', '.join(cells)[:60]}' stands where names do and holds the number {number}: "
            "repair it if it is a row, or say header = true in [log] if it is names"
        )
    return tuple(cells)


def _without_end(cells: list[str], columns: int) -> list[str]:
    """Return the cells of a head without the empty one behind a separator at its end."""
    return cells[:-1] if len(cells) == columns + 1 and not cells[-1] else cells


def _bare(line: str, separator: str, columns: int = 0) -> list[str]:
    """Return the cells of a line above the data, without the sign of a remark.

    Blanks separate names and are part of them, as in `time (s)   torque (N m)`. Where they make another number of cells
    than the data have, and wider gaps or brackets make as many, those are the names.
    """
    text = line.strip(" ")
    for sign in COMMENT:
        if text.startswith(sign):
            text = text.lstrip(sign).strip(" ")
            break
    cells = cells_of(text, separator)
    if separator == " " and 1 < columns < len(cells):
        ways = (re.split(r"\s{2,}|\t", text), re.findall(_NAME_AND_UNIT, text))
        cells = next((way for way in ways if len(way) == columns), cells)
    return cells


def _are_units(cells: Sequence[str]) -> bool:
    from campaigns.importing.clock import is_time_unit
    from campaigns.log.units import is_count, is_unit

    written = [cell for cell in cells if cell]
    told = (is_unit, is_time_unit, is_count, _BRACKETED.fullmatch, "-".__eq__)
    return bool(written) and all(any(tells(cell) for tells in told) for cell in written)
