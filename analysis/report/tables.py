"""One table in all its formats: CSV with every digit, LaTeX and HTML for reading, all from one DataFrame."""

from __future__ import annotations

import math
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.pages.formats import NONE, exact, rounded, shown, unit_text
from analysis.paper.rows import Row, Table
from analysis.report.strategies import OWN
from campaigns.spreadsheet import inert_frame
from sim_backend.safe_write import write_text

if TYPE_CHECKING:
    import pandas as pd

THEIRS = "paper's controllers here"
"""Head of a table that compares; elsewhere it is called ours."""

KEPT = "kept"
"""Mark of a row that lies within a bound, which is not agreement."""

_MARKS = {True: "yes", False: "no", None: NONE}

NOISY = "noise decides"
"""What stands where another repeat may well give the other answer."""

UNDETERMINED = "not determined"
"""What stands where ours is more uncertain than it is large."""


def agreement_text(row: Row) -> str:
    """Return in a word whether ours agrees; a bound is kept, which is not agreement.

    Where the noise decides, the share of repeats that agree stands beside it.
    """
    if row.noisy and row.share is not None:
        return f"{NOISY}: {100.0 * row.share:.0f}\N{NO-BREAK SPACE}% agree"
    if not row.determined:
        return UNDETERMINED
    return KEPT if row.inside and row.ok is None else _MARKS[row.ok]


def display_frame(table: Table) -> pd.DataFrame:
    """Return the table as text: rounded numbers, the deviation, the tolerance, and whether ours agrees."""
    import pandas as pd

    columns: dict[str, list[str]] = {"row": [r.number.row for r in table.rows]}
    if any(r.number.requirement is not None for r in table.rows):
        columns["required"] = [_required(r) for r in table.rows]
    columns["paper"] = [paper_text(r) for r in table.rows]
    columns["ours"] = [ours_text(r) for r in table.rows]
    if table.compared:
        columns[OWN] = [own_text(r) for r in table.rows]
    columns["deviation"] = [_deviation(r) for r in table.rows]
    columns["tolerance"] = [tolerance_text(r) for r in table.rows]
    columns["unit"] = [unit_text(r.number.unit) for r in table.rows]
    columns["label"] = [r.number.label for r in table.rows]
    columns["agrees"] = [agreement_text(r) for r in table.rows]
    return pd.DataFrame(columns)


def _required(row: Row) -> str:
    text = exact(row.number.requirement)
    return text if row.number.requirement is None else f"{'≥' if row.number.at_least else '≤'} {text}"


def paper_text(row: Row) -> str:
    """Return the paper's number as printed."""
    text = row.number.printed or exact(row.number.value)
    return f"≤ {text}" if row.number.upper else text


def tolerance_text(row: Row) -> str:
    """Return how far ours may lie from the paper's number, or above it."""
    return f"{'+' if row.number.upper else '±'}{exact(row.number.tolerance)}"


def ours_text(row: Row) -> str:
    """Return ours to two digits of its standard deviation, which stands beside it, or with the digits of `_last`."""
    if row.std and row.ours is not None:
        return f"{shown(row.ours, std=row.std)} ± {shown(row.std, std=row.std)}"
    return _plain(row, row.ours)


def own_text(row: Row) -> str:
    """Return the number of this project's design in the same way, without its standard deviation."""
    return shown(row.own, std=row.own_std) if row.own_std else _plain(row, row.own)


def _deviation(row: Row) -> str:
    deviation, paper = row.deviation, row.number.value
    if deviation is None or paper is None or math.isnan(deviation):
        return NONE
    if abs(deviation) <= 1e-9 * abs(paper):  # the rounding of floating-point numbers
        return "0"
    text = shown(deviation, std=row.std) if row.std else _plain(row, deviation, row.ours)
    return text if text in ("0", "never") or text.startswith("−") else f"+{text}"


def _plain(row: Row, value: float | None, beside: float | None = None) -> str:
    """Return a number of which no scatter is known, in the digits that `_last` gives it or what stands `beside` it."""
    if value is None or value == 0.0 or not math.isfinite(value):
        return shown(value)
    last = _last(row, value if beside is None else beside)
    return rounded(value, last) if round(value, -last) else "0"


def _last(row: Row, ours: float) -> int:
    """Return the power of ten of the last digit of ours and of its deviation, so that ours less the paper's gives it.

    All digits of the paper stand, and two of ours and of the deviation, but none below a thousandth of the tolerance.
    """
    paper, tolerance = row.number.value, row.number.tolerance
    wanted = [_size(ours) - 1]
    if paper is not None:
        wanted.append(int(Decimal(row.number.digits).as_tuple().exponent))
        if abs(ours - paper) > 1e-9 * abs(paper):  # else the rounding of floating-point numbers
            wanted.append(_size(ours - paper) - 1)
    return max(min(wanted), _size(tolerance) - 3) if tolerance > 0.0 else min(wanted)


def _size(value: float) -> int:
    return math.floor(math.log10(abs(value)))


def write_table(table: Table, folder: Path, html: str) -> dict[str, Path]:
    """Write a table into `folder` as CSV, LaTeX and HTML; return the paths by format."""
    stem = f"table-{table.key}"
    paths = {form: folder / f"{stem}.{form}" for form in ("csv", "tex", "html")}
    write_text(paths["csv"], inert_frame(table.frame()).to_csv(index=False, lineterminator="\n"))
    write_text(paths["tex"], latex(table))
    write_text(paths["html"], html)
    return paths


def latex(table: Table) -> str:
    """Return the table as a LaTeX table (booktabs; UTF-8, as XeLaTeX and LuaLaTeX read it)."""
    frame = display_frame(table)
    if table.compared:
        frame = frame.rename(columns={"ours": THEIRS})
    return str(
        frame.to_latex(
            index=False,
            escape=True,
            caption=f"Table {table.key}: {table.paper.title}" if table.key != "text" else table.paper.title,
            label=f"tab:{table.key}",
            column_format="l" + "r" * (frame.shape[1] - 4) + "lll",
        )
    )
