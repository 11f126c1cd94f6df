"""`mccd compare`: two runs, models or diagnoses side by side."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mccdcli.options import common_options
from mccdcli.output import emit, table
from mccdcli.progress import progress

if TYPE_CHECKING:
    from analysis.comparison import Comparison

WIDEST = 60
"""Characters of a text in the table on a terminal; the page and the JSON have all of it."""


@click.command()
@click.argument("first", metavar="A")
@click.argument("second", metavar="B")
@common_options("out", "json")
def compare(first: str, second: str, out: Path | None, as_json: bool) -> None:
    """Compare two logs, models or diagnoses: a table, and with --out a page with plots over each other.

    Which of these they are is recognised from the files; a diagnosis is the folder that diagnose wrote, or its
    diagnosis.json. The difference is B minus A, and σ its standard deviation where both values have one.

    \b
    Examples:
      mccd compare monday.h5 tuesday.h5 --out compare.html
      mccd compare nominal.toml diagnosis/extended.toml
      mccd compare before/ after/ --json
    """
    from analysis.comparison import compare as compared

    if out is not None:
        from analysis.comparison.page import require_page

        require_page(out)
    with progress("comparing") as report:
        report(0.0, 2.0, f"{first} and {second}")
        found = compared(first, second)
        page = None
        if out is not None:
            from analysis.comparison.page import write_comparison

            report(1.0, 2.0, "page")
            page = write_comparison(found, out)
    emit({**found.as_json(), "page": page}, as_json=as_json, text=_text(found, page))


def _text(found: Comparison, page: Path | None) -> str:
    from analysis.pages.formats import printed  # as the page prints it

    parts = []
    for part in found.parts:
        rows = [tuple(_short(printed(text)) for text in row.texts()) for row in part.rows]
        shown = [table(rows, heads=(part.title, "A", "B", "difference", "unit"))] if rows else [part.title]
        parts.append("\n".join([*shown, *([printed(part.remark)] if part.remark else [])]))
    parts.append(f"A: {found.names[0]}\nB: {found.names[1]}" + ("" if page is None else f"\npage: {page}"))
    return "\n\n".join(parts)


def _short(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= WIDEST else f"{line[: WIDEST - 1]}…"
