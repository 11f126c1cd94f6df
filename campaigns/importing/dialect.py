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

from campaigns.log.guard import first_line
from campaigns.spreadsheet import as_named
from sim_backend.errors import DataError

SEPARATORS = ("\t", ";", ",", "|", " ")
"""What may stand between cells, " " for any run of blanks; of equally good ones the first is taken."""

COMMENT = ("#", "%", "//", "!")
"""What begins a line of remarks above the data; inside the data `#` alone does."""

MISSING = frozenset(
    ("", "-", "--", "na", "n/a", "#n/a", "#na", "null", "none", "nan", "+nan", "-nan", "nan(ind)", "-nan(ind)", "inf")
    + ("+inf", "-inf", "#value!", "#div/0!", "#num!", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind", "1.#inf", "-1.#inf")
)
"""Cells that stand where a number is not known, in lower case."""

_SAMPLE_LINES = 400
MAX_LINE_CHARS = 2**20
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_BEHIND = re.compile(r"\d+([eEdD][+-]?\d+)?")
_LEADING_ZERO = re.compile(r"0\d")
_BRACKETED = re.compile(r"[\[(<].*[\])>]")


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


def read_number(cell: str, decimal: str) -> float | None:
    """Return the number in a cell, None where it is none: blanks around it and Fortran's exponent D are taken."""
    text = cell.strip()
    if decimal != ".":
        if "." in text:
            return None
        text = text.replace(decimal, ".")
    if not _NUMBER.fullmatch(text):
        return None
    return float(text.replace("d", "e").replace("D", "e"))


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


def dialect_of(path: Path, separator: str | None, decimal: str | None, header: bool | None) -> Dialect:
    """Return how the table at `path` is written; what the map says is taken as said.

    Raises DataError where the table has no rows of numbers, or can be read in more than one way.
    """
    encoding = encoding_of(path)
    lines = _sample(path, encoding)
    if not any(line.strip() and not is_remark(line) for line in lines):
        raise DataError(f"{path} holds no line of data: check that it is the right file")
    named = separator is not None
    separator = separator or _separator(lines, decimal)
    rows = [cells_of(line, separator) for line in lines]
    plain = [row for row, line in zip(rows, lines, strict=True) if line.strip() and not is_remark(line)]
    columns = _columns(plain)
    # a remark at the end of a line of data is no part of its last cell
    lines = [line if is_remark(line) else without_remark(line, separator, columns) for line in lines]
    rows = [cells_of(line, separator) for line in lines]
    plain = [row for row, line in zip(rows, lines, strict=True) if line.strip() and not is_remark(line)]
    decimal_named = decimal is not None
    decimal = decimal or _decimal(plain, columns, separator, path)
    first = _first_row(lines, rows, columns, decimal, path)
    trailing = columns > 1 and separator != " " and all(not r[-1] for r in rows[first:] if len(r) == columns)
    # a last column that has a name is one, empty as it may be
    trailing = trailing and not any(len(row) == columns and row[-1] for row in rows[:first])
    found = _head(path, lines, rows, first, columns - trailing, separator, decimal, header)
    names, units, first = tuple(map(as_named, found[0])), *found[1:]
    full = [row for row in rows[first:] if len(row) == columns]
    doubt = "" if named and decimal_named else _doubt(path, full, separator, names)
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
            raise DataError(f"{path} has a line of more than {MAX_LINE_CHARS} characters: check that it is a table")
        yield line


def _is_number(cell: str, decimal: str | None) -> bool:
    return any(read_number(cell, sign) is not None for sign in ([decimal] if decimal else [".", ","]))


def _fits(cell: str, decimal: str) -> bool:
    """Tell whether a cell may stand in a column of numbers."""
    return read_number(cell, decimal) is not None or cell.lower() in MISSING


def _separator(lines: Sequence[str], decimal: str | None) -> str:
    """Return the separator by which the most cells of the most rows are numbers."""
    plain = [line for line in lines if line.strip() and not is_remark(line)]
    best, most = ",", 0.0
    for separator in SEPARATORS:
        rows = [cells_of(line, separator) for line in plain]
        columns = _columns(rows)
        full = [row for row in rows if len(row) == columns]
        if columns < 2:
            continue
        score = sum(sum(_is_number(c, decimal) for c in row) / columns for row in full)
        if score > most + 1e-9:
            best, most = separator, score
    return best


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
    shares = [sum(_fits(row[i], decimal) for row in full) / len(full) for i in range(columns)]
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
        if any(known) and all(_fits(cell, decimal) for cell in cells):
            return k
    raise DataError(f"{path} holds no row of numbers: check that it is the right file")


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
    above = [_bare(lines[k], separator) for k in range(first) if lines[k].strip()]
    remarks = [is_remark(lines[k]) for k in range(first) if lines[k].strip()]
    data = [list(row[:columns]) for row in rows[first : first + 50] if len(row) >= columns]
    # where names can be the first row alone: a title above it has other cells than it
    bare = all(remark or (columns > 1 and len(line) != columns) for line, remark in zip(above, remarks, strict=True))
    if header is True and bare:
        return tuple(data[0]), (), first + 1
    if header is not False and bare and not any(remarks) and _may_be_names(path, data[0], data[1:], decimal):
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
        _check_no_units(path, data[0], data[1:], decimal)
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


def _bare(line: str, separator: str) -> list[str]:
    """Return the cells of a line above the data, without the sign of a remark."""
    text = line.strip(" ")
    for sign in COMMENT:
        if text.startswith(sign):
            text = text.lstrip(sign).strip(" ")
            break
    return cells_of(text, separator)


def _are_units(cells: Sequence[str]) -> bool:
    from campaigns.log.units import is_unit

    written = [cell for cell in cells if cell]
    return bool(written) and all(_BRACKETED.fullmatch(cell) or cell == "-" or is_unit(cell) for cell in written)


def _may_be_names(path: Path, row: Sequence[str], others: Sequence[Sequence[str]], decimal: str) -> bool:
    """Tell whether a first line that holds numbers alone are names, as tables that were given none have.

    Those are whole numbers that count from 0 or 1, beside an empty cell for the rows' own names.
    """
    counted = [cell for cell in row if cell]
    whole = [int(cell) for cell in counted if cell.isdecimal()]
    counts = len(whole) == len(counted) > 0 and whole in (
        list(range(len(whole))),
        list(range(1, len(whole) + 1)),
    )
    if not counts:
        return False
    if len(counted) < len(row):
        return not row[0] and all(all(other) for other in others)
    if len(row) == 1 or not others or not all(_fractions(others, decimal)[1:]):
        return False
    raise DataError(
        f"{path}: the first line ({', '.join(row)}) may be names or data: say header = true (names) or "
        "header = false (data) in [log]"
    )


def _fractions(rows: Sequence[Sequence[str]], decimal: str) -> list[bool]:
    """Tell for each column whether all its numbers have a fraction or an exponent.

    Whole numbers above such were written by another hand.
    """
    return [all(decimal in cell or "e" in cell.lower() for cell in column) for column in zip(*rows, strict=True)]


def _check_no_units(path: Path, row: Sequence[str], others: Sequence[Sequence[str]], decimal: str) -> None:
    """Raise DataError where a first row of ones, below names, may be the units of quantities that have none."""
    if others and all(cell == "1" for cell in row) and all(_fractions(others, decimal)):
        raise DataError(
            f"{path}: the line below the names ({', '.join(row)}) may be units or data: take it out, "
            f"or write 1{decimal}0 in it if it is data"
        )


def _doubt(path: Path, rows: Sequence[Sequence[str]], separator: str, names: Sequence[str]) -> str:
    """Return what to say where the commas between cells may be decimal commas, else an empty text."""
    cells = [cell for row in rows for cell in row]
    if separator != "," or any("." in cell for cell in cells):
        return ""
    digits = next((cell for row in rows for cell in row[1:] if _LEADING_ZERO.match(cell)), None)
    halves = [cell for row in rows for cell in row[1::2]]
    unnamed = not any(names) and len(rows[0]) % 2 == 0 and all(map(_BEHIND.fullmatch, halves))
    if digits is None and not unnamed:
        return ""
    shown = digits or halves[0]
    return (
        f"{path}: the cell '{shown}' may be the digits behind a decimal comma, but the comma separates cells: save it "
        'with another separator, or say delimiter = "," and decimal = "." in [log] if it is a number of its own'
    )
