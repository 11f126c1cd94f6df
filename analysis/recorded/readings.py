"""Readings of an instrument beside the bench, from a CSV file."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sim_backend.errors import DataError
from sim_backend.small_files import TOML_BYTES, read_small

Array = NDArray[np.float64]

COLUMNS = ("theta_x", "theta_y")


def read_angles(path: Path, rows: int) -> Array:
    """Return columns theta_x and theta_y (rad) of a CSV file as (rows, 2).

    Raises DataError, naming the row, for a file that cannot be read, lacks a column, has another number of rows or a
    cell that is not a finite number.
    """
    try:
        text = read_small(path, TOML_BYTES).decode("utf-8-sig")
        table = list(csv.DictReader(io.StringIO(text, newline=""), restkey="without a name"))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"{path}: cannot be read as CSV ({error}); save it as UTF-8 text with commas") from None
    missing = [name for name in COLUMNS if not table or name not in table[0]]
    if missing or len(table) != rows:
        raise DataError(
            f"{path}: {len(table)} rows, columns {', '.join(table[0]) if table else 'none'}; "
            f"give columns {' and '.join(COLUMNS)} in rad and one row for each of {rows} held points"
        )
    out = np.empty((rows, len(COLUMNS)))
    for i, row in enumerate(table):
        for j, name in enumerate(COLUMNS):
            try:
                out[i, j] = float(row[name] or "nan")
            except ValueError:
                out[i, j] = np.nan
            if not np.isfinite(out[i, j]):
                raise DataError(f"{path}: row {i + 2}, column {name} holds {row[name]!r}; write an angle in rad")
    return out
