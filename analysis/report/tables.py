"""One table in all its formats: CSV with every digit, LaTeX and HTML for reading, all from one DataFrame."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.pages.formats import NONE, exact, shown, unit_text
from analysis.paper.rows import Row, Table
from campaigns.spreadsheet import inert_frame
from sim_backend.safe_write import write_text

if TYPE_CHECKING:
    import pandas as pd

OWN = "this project"
THEIRS = "paper's controllers here"
"""Heads of a table that compares; elsewhere the second is called ours."""

KEPT = "kept"
"""Mark of a row that lies within a bound, which is not agreement."""

_MARKS = {True: "yes", False: "no", None: NONE}

UNDETERMINED = "not determined"
"""What stands where ours is more uncertain than it is large."""


def agreement_text(row: Row) -> str:
    """Return in a word whether ours agrees; a bound is kept, which is not agreement."""
    if not row.determined:
        return UNDETERMINED
    return KEPT if row.inside and row.ok is None else _MARKS[row.ok]


def display_frame(table: Table) -> pd.DataFrame:
    """Return the table as text: rounded numbers, the deviation, the tolerance, and whether ours agrees."""
    import pandas as pd

    columns: dict[str, list[str]] = {"row": [r.number.row for r in table.rows]}
    if any(r.number.requirement is not None for r in table.rows):
        columns["required"] = [_required(r) for r in table.rows]
    columns["paper"] = [_paper(r) for r in table.rows]
    columns["ours"] = [_ours(r) for r in table.rows]
    if table.compared:
        columns[OWN] = [shown(r.own, like=r.number.value, std=r.own_std) for r in table.rows]
    columns["deviation"] = [_deviation(r) for r in table.rows]
    columns["tolerance"] = [f"{'+' if r.number.upper else '±'}{exact(r.number.tolerance)}" for r in table.rows]
    columns["unit"] = [unit_text(r.number.unit) for r in table.rows]
    columns["label"] = [r.number.label for r in table.rows]
    columns["agrees"] = [agreement_text(r) for r in table.rows]
    return pd.DataFrame(columns)


def _required(row: Row) -> str:
    text = exact(row.number.requirement)
    return text if row.number.requirement is None else f"{'≥' if row.number.at_least else '≤'} {text}"


def _paper(row: Row) -> str:
    text = row.number.printed or exact(row.number.value)
    return f"≤ {text}" if row.number.upper else text


def _deviation(row: Row) -> str:
    deviation, paper = row.deviation, row.number.value
    if deviation is None or paper is None or math.isnan(deviation):
        return NONE
    if abs(deviation) <= 1e-9 * abs(paper):  # the rounding of floating-point numbers
        return "0"
    digits = f"{deviation:.2g}" if row.std is None and abs(deviation) < math.inf else None
    text = shown(deviation, std=row.std) if digits is None else shown(float(digits), like=float(digits) or 1.0)
    return text if text.startswith("−") or math.isinf(deviation) else f"+{text}"


def _ours(row: Row) -> str:
    text = shown(row.ours, like=row.number.value, std=row.std)
    if row.std is not None and row.ours is not None and row.std > 0.0:
        return f"{text} ± {shown(row.std, std=row.std)}"
    return text


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
