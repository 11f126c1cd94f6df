"""Tables that could be read in two ways: each is refused with the key of the map that decides."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from campaigns.importing.cells import DATE, read_number
from sim_backend.errors import DataError

_BEFORE = re.compile(r"[+-]?\d+")
_BEHIND = re.compile(r"\d+([eEdD][+-]?\d+)?")
_LEADING_ZERO = re.compile(r"0\d+([eEdD][+-]?\d+)?")


def may_be_names(path: Path, row: Sequence[str], others: Sequence[Sequence[str]], decimal: str) -> bool:
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


def check_no_units(path: Path, row: Sequence[str], others: Sequence[Sequence[str]], decimal: str) -> None:
    """Raise DataError where a first row of ones, below names, may be the units of quantities that have none."""
    if others and all(cell == "1" for cell in row) and all(_fractions(others, decimal)):
        raise DataError(
            f"{path}: the line below the names ({', '.join(row)}) may be units or data: take it out, "
            f"or write 1{decimal}0 in it if it is data"
        )


def comma_doubt(path: Path, rows: Sequence[Sequence[str]], separator: str, names: Sequence[str]) -> str:
    """Return what to say where the commas between cells may be decimal commas, else an empty text."""
    cells = [cell for row in rows for cell in row]
    if separator != "," or any("." in cell and read_number(cell, ".") is not None for cell in cells):
        return ""
    shown = next((cell for row in rows for cell in row[1:] if _LEADING_ZERO.fullmatch(cell)), None)
    # names that are numbers may be a row as well
    named = any(name and read_number(name, ".") is None for name in names)
    if shown is None and not named:
        columns = list(zip(*rows, strict=True))
        pairs = zip(columns[:-1], columns[1:], strict=True)
        shown = next((second[0] for first, second in pairs if _may_be_one(first, second)), None)
    if shown is None:
        return ""
    return (
        f"{path}: the cell '{shown}' may be the digits behind a decimal comma, but the comma separates cells: save it "
        'with another separator, or say delimiter = "," and decimal = "." in [log] if it is a number of its own'
    )


def _may_be_one(before: Sequence[str], behind: Sequence[str]) -> bool:
    """Tell whether two columns may be what stands before and behind a decimal comma, of numbers or of seconds."""
    heads = all(_BEFORE.fullmatch(cell) or DATE.fullmatch(cell) for cell in before)
    return heads and all(map(_BEHIND.fullmatch, behind))
