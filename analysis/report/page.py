"""The page: what the tables and figures say first, then all of them, in one self-contained file."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from analysis.design.stages import STAGE_HEADS, StageResult, stage_rows
from analysis.pages.environment import page_environment
from analysis.pages.explorer import Explorer
from analysis.pages.formats import printed, unit_text
from analysis.pages.svg import inlined
from analysis.paper.pieces import Evidence
from analysis.paper.rows import Table, label_counts
from analysis.report.strategies import TERMS
from analysis.report.tables import (
    agreement_text,
    display_frame,
    ours_text,
    own_text,
    paper_text,
    tolerance_text,
)
from analysis.report.verdict import simulated, verdict_of
from campaigns.log import Run
from campaigns.version import tool_commit, tool_version

if TYPE_CHECKING:
    import jinja2
    import pandas as pd


@dataclass(frozen=True)
class FigurePart:
    """A figure as the page needs it: its SVG text, the file it was written to, and the runs that it rests on."""

    key: str
    title: str
    caption: str
    svg: str
    path: Path
    run_uids: tuple[str, ...]
    numbers: pd.DataFrame

    def digest(self) -> pd.DataFrame:
        """Return what each curve spans, one row per curve: for readers who cannot see the drawing."""
        import pandas as pd

        rows = []
        for (panel, series), part in self.numbers.groupby(["panel", "series"], sort=False):
            x, y = part["x"], part["y"]
            rows.append((panel, series, str(len(part)), x.min(), x.max(), y.min(), y.mean(), y.max()))
        heads = ("panel", "curve", "points", "x from", "to", "lowest", "mean", "highest")
        return pd.DataFrame(rows, columns=list(heads))


def exactly(value: float | None) -> Markup:
    """Return every digit of a number for the page's machine-readable values; empty where JSON has null."""
    return Markup(repr(float(value)) if value is not None and math.isfinite(value) else "")


_NAMED = re.compile(r"\b(Table|Fig\.) (\d\.\d+|A\d)\b")


def linked(text: str, anchors: Collection[str]) -> Markup:
    """Return a text whose tables and figures are links, where the page has their `anchors`."""

    def link(found: re.Match[str]) -> str:
        anchor = f"{'table' if found[1] == 'Table' else 'figure'}-{found[2]}"
        return f'<a href="#{anchor}">{found[0]}</a>' if anchor in anchors else found[0]

    return Markup(_NAMED.sub(link, str(escape(printed(text)))))


def _environment() -> jinja2.Environment:
    environment = page_environment("analysis.report")
    environment.filters["exactly"] = exactly
    environment.filters |= {"linked": linked, "unit": unit_text, "capitalize_first": _capitalised}
    environment.globals |= {"frame_of": display_frame, "anchors": ()}
    environment.globals |= {
        one.__name__: one for one in (agreement_text, ours_text, own_text, paper_text, tolerance_text)
    }
    return environment


def render_table(table: Table) -> str:
    """Return one table as an HTML fragment, the same that stands on the page."""
    return str(_environment().get_template("table.html.j2").render(table=table))


def render_page(
    runs: Sequence[Run],
    tables: dict[str, Table],
    figures: dict[str, FigurePart],
    evidence: Sequence[Evidence],
    explorers: Sequence[Explorer] = (),
    stages: Sequence[StageResult] = (),
) -> str:
    """Return the whole page. It holds no time of its own, so identical logs give identical bytes."""
    environment = _environment()
    drawings = {key: inlined(part.svg, f"f{key.replace('.', '-')}", _quoted(part)) for key, part in figures.items()}
    page = environment.get_template("index.html.j2").render(
        runs=runs,
        bench=_bench(runs),
        tables=tables,
        figures=figures,
        drawings={key: Markup(svg) for key, svg in drawings.items()},
        evidence=evidence,
        explorers=explorers,
        stages=(STAGE_HEADS, stage_rows(stages)) if stages else None,
        verdict=verdict_of(tables, runs),
        simulated=sum(map(simulated, runs)),
        terms=TERMS,
        anchors={*(f"table-{key}" for key in tables), *(f"figure-{key}" for key in figures)},
        counts=label_counts(list(tables.values())),
        version=f"{tool_version()} ({tool_commit()})",
    )
    return str(page)


def _capitalised(text: str) -> str:
    return text[:1].upper() + text[1:]


def _quoted(part: FigurePart) -> str:
    return str(escape(f"Figure {part.key}: {part.title}"))


def _bench(runs: Sequence[Run]) -> str:
    return ", ".join(sorted({f"{r.header.bench.get('name', '')} ({r.header.bench.get('kind', '')})" for r in runs}))
