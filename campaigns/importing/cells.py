"""What one cell of a text table holds: a number, a date, or nothing where a number is not known."""

from __future__ import annotations

import re

MISSING = frozenset(
    ("", "-", "--", "na", "n/a", "#n/a", "#na", "null", "none", "nan", "+nan", "-nan", "nan(ind)", "-nan(ind)", "inf")
    + ("+inf", "-inf", "#value!", "#div/0!", "#num!", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind", "1.#inf", "-1.#inf")
)
"""Cells that stand where a number is not known, in lower case."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eEdD][+-]?\d+)?")
DATE = re.compile(r"\d{1,4}[-/.:]\d{1,2}[-/.:]\d{1,4}([T ]\d{1,2}:\d{2}(:\d{2})?)?([.,]\d+)?(Z|[+-]\d{2}:?\d{2})?")


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


def is_number(cell: str, decimal: str | None) -> bool:
    """Tell whether a cell is a number, with either decimal sign where none is given."""
    return any(read_number(cell, sign) is not None for sign in ([decimal] if decimal else [".", ","]))


def fits(cell: str, decimal: str) -> bool:
    """Tell whether a cell may stand in a column of numbers."""
    return read_number(cell, decimal) is not None or cell.lower() in MISSING


def digits_of(cell: str, decimal: str) -> tuple[int, bool]:
    """Return how many significant digits a number is written with, and whether it is a whole one."""
    mantissa, *exponent = re.split(r"[eEdD]", cell.strip().strip('"').lstrip("+-"), maxsplit=1)
    return len(mantissa.replace(decimal, "").lstrip("0")), decimal not in mantissa and not exponent
