"""Build the report of a campaign's folder: every table and figure as files, the page, and `report.json`."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.design.stages import stages_csv
from analysis.pages.canvas import Canvas
from analysis.pages.cut_off import cut_off
from analysis.paper.evidence import EVIDENCE
from analysis.paper.figures import FIGURES, make_figure
from analysis.paper.measured import Measured
from analysis.paper.pieces import Evidence
from analysis.paper.rows import Table
from analysis.paper.tables import TABLES, make_table
from analysis.report.explore import make_explorers
from analysis.report.page import FigurePart, render_page, render_table
from analysis.report.stages import measured_stages
from analysis.report.tables import write_table
from campaigns.spreadsheet import inert_frame
from campaigns.version import tool_commit, tool_version
from sim_backend.safe_write import folder_within, write_text

Progress = Callable[[float, float, str], None]


@dataclass(frozen=True)
class Report:
    """A finished report: its `folder`, `tables` and `figures` (paths of the SVG files) by number, `page` and `json`."""

    folder: Path
    tables: dict[str, Table]
    figures: dict[str, Path]
    page: Path
    json: Path

    def content(self, relative: bool = False) -> dict[str, Any]:
        """Return {"tables": {number: rows}, "figures": {number: path}}; paths absolute, or relative to the folder."""
        figures = {
            key: path.relative_to(self.folder).as_posix() if relative else str(path.resolve())
            for key, path in self.figures.items()
        }
        tables = {key: table.as_json() for key, table in self.tables.items()}
        return {"tables": tables, "figures": figures}


def build_report(logs: Path, out: Path, progress: Progress | None = None, designed: Path | None = None) -> Report:
    """Build the report of the logs in `logs` into `out`, whose files of the same names are replaced.

    `designed` is a folder with the logs of this project's controller, whose numbers then stand beside the others.

    Raises ConfigError when there is no complete log, DataError for a log that cannot be read.
    """
    with Measured(logs, *(() if designed is None else (designed,))) as measured:
        return report_of(measured, out, progress)


def report_of(measured: Measured, out: Path, progress: Progress | None = None) -> Report:
    """Build the report of what is measured as `build_report` does; raises DataError for a log that cannot be read."""
    tell = progress or _silent
    total = float(len(TABLES) + len(FIGURES) + 1)
    for name in ("tables", "figures"):
        folder_within(out, name)
    tables: dict[str, Table] = {}
    for key in TABLES:
        tell(float(len(tables)), total, f"table {key}")
        tables[key] = make_table(key, measured)
        write_table(tables[key], out / "tables", render_table(tables[key]))
    figures: dict[str, FigurePart] = {}
    for i, key in enumerate(FIGURES):
        tell(float(len(TABLES) + i), total, f"figure {key}")
        canvas = make_figure(key, measured)
        if canvas is not None:
            figures[key] = _write_figure(key, canvas, measured, out / "figures")
    tell(total - 1.0, total, "page")
    explorers = make_explorers(measured)
    _write_json({one.key: one.as_json() for one in explorers}, out / "explore.json", indent=None)
    evidence = [make() for make in EVIDENCE]
    _write_evidence(evidence, out / "tables")
    page = out / "index.html"
    stages = measured_stages(measured)
    if stages:
        write_text(out / "tables" / "stages.csv", stages_csv(stages))
    write_text(page, render_page(measured.runs, tables, figures, evidence, explorers, stages))
    report = Report(out, tables, {key: part.path for key, part in figures.items()}, page, out / "report.json")
    _write_json(report.content(relative=True), report.json)
    return report


def _write_json(content: dict[str, Any], path: Path, indent: int | None = 2) -> None:
    write_text(path, json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=False) + "\n")


def _write_figure(key: str, canvas: Canvas, measured: Measured, folder: Path) -> FigurePart:
    path = folder / f"figure-{key}.svg"
    svg = canvas.svg(_stamp(canvas, measured))
    write_text(path, svg)
    caption = f"{canvas.caption} {cut_off(canvas)}".rstrip()
    numbers = canvas.numbers()
    write_text(
        path.with_suffix(".csv"), inert_frame(numbers).to_csv(index=False, lineterminator="\n", float_format="%.9g")
    )
    return FigurePart(key, canvas.title, caption, svg, path, canvas.run_uids, numbers)


def _stamp(canvas: Canvas, measured: Measured) -> str:
    """What a figure rests on: runs, bench, seeds and code."""
    runs = [run for run in measured.runs if run.run_uid in canvas.run_uids]
    if not runs:
        return f"computed from design models · mccd {tool_version()} ({tool_commit()})"
    uids = ", ".join(run.run_uid[:8] for run in runs)
    first = runs[0].header
    seeds = ", ".join(sorted({str(run.header.seed) for run in runs}))
    if len(runs) > 2:
        seeds = f"as listed with the {len(runs)} runs"
    bench = f"{first.bench.get('kind', '')} {first.bench.get('name', '')}".strip()
    return f"runs {uids} · seed {seeds} · bench {bench} · mccd {first.tool_version} ({first.tool_commit})"


def _write_evidence(evidence: list[Evidence], folder: Path) -> None:
    import pandas as pd

    for i, item in enumerate(evidence, start=1):
        frame = pd.DataFrame(item.rows, columns=list(item.heads))
        write_text(folder / f"evidence-{i}.csv", inert_frame(frame).to_csv(index=False, lineterminator="\n"))


def _silent(done: float, total: float, what: str) -> None:
    """Say nothing."""
