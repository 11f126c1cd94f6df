"""The page: what the tables and figures say first, then all of them, in one self-contained file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from analysis.design.stages import STAGE_HEADS, StageResult, stage_rows
from analysis.pages.environment import page_environment
from analysis.pages.explorer import Explorer
from analysis.pages.svg import inlined
from analysis.paper.pieces import Evidence
from analysis.paper.rows import Row, Table, label_counts
from analysis.report.tables import display_frame
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


@dataclass(frozen=True)
class Verdict:
    """What the page says first: requirements met of those measured, missed ones by name, predictions in tolerance.

    The numbers of this project's own design stand apart.
    """

    met: int
    measured: int
    missed: tuple[str, ...]
    agreeing: int
    predictions: int
    failures: dict[str, tuple[Row, ...]]
    own_met: int = 0
    own_measured: int = 0
    own_missed: tuple[str, ...] = ()


def verdict_of(tables: dict[str, Table]) -> Verdict:
    """Return the verdict over all tables; the requirements are those of Table 6.6."""
    required = [row for row in tables["6.6"].rows if row.met is not None] if "6.6" in tables else []
    own = [row for row in tables["6.6"].rows if row.own_met is not None] if "6.6" in tables else []
    rows = [row for table in tables.values() for row in table.rows]
    known = [row for row in rows if row.number.label == "predicted" and row.ok is not None]
    return Verdict(
        met=sum(bool(row.met) for row in required),
        measured=len(required),
        missed=tuple(row.number.row for row in required if not row.met),
        agreeing=sum(bool(row.ok) for row in known),
        predictions=len(known),
        failures={
            key: failed for key, table in tables.items() if (failed := tuple(row for row in table.rows if row.failed))
        },
        own_met=sum(bool(row.own_met) for row in own),
        own_measured=len(own),
        own_missed=tuple(row.number.row for row in own if not row.own_met),
    )


def exactly(value: float | None) -> Markup:
    """Return every digit of a number for the page's machine-readable values; empty where JSON has null."""
    return Markup(repr(float(value)) if value is not None and math.isfinite(value) else "")


def _environment() -> jinja2.Environment:
    environment = page_environment("analysis.report")
    environment.filters["exactly"] = exactly
    environment.globals["frame_of"] = display_frame
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
        verdict=verdict_of(tables),
        counts=label_counts(list(tables.values())),
        version=f"{tool_version()} ({tool_commit()})",
    )
    return str(page)


def _quoted(part: FigurePart) -> str:
    return str(escape(f"Figure {part.key}: {part.title}"))


def _bench(runs: Sequence[Run]) -> str:
    return ", ".join(sorted({f"{r.header.bench.get('name', '')} ({r.header.bench.get('kind', '')})" for r in runs}))
