"""Texts of a CSV table that no spreadsheet takes for a formula, and their decoding.

A name of a channel or a segment may come from anybody, and a cell that begins with `=`, `+`, `-`, `@`, a tab or a line
break is a formula where a spreadsheet opens the table. An apostrophe in front makes it text. One stands in front of
names that begin with apostrophes before such a character, too: so taking one away always gives back what was there.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

_FORMULA = re.compile(r"'*[=+\-@\t\r\n＝＋－＠]")
_INERT = re.compile(r"'+[=+\-@\t\r\n＝＋－＠]")


def inert(text: str) -> str:
    """Return `text` as a cell that is not a formula; what reads as a number is one and stays as it is."""
    return f"'{text}" if _FORMULA.match(text) and not _is_number(text) else text


def as_named(cell: str) -> str:
    """Return the text that `inert` has made a cell of."""
    return cell[1:] if _INERT.match(cell) else cell


def inert_frame(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a table with its heads and text cells as `inert` has them; numbers are untouched."""
    texts = {name: column.map(_inert_cell) for name, column in frame.items() if column.dtype.kind not in "biufc"}
    return frame.assign(**texts).rename(columns=inert) if texts else frame.rename(columns=inert)


def _inert_cell(value: object) -> object:
    return inert(value) if isinstance(value, str) else value


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
