"""Two runs side by side: headers, settings that differ, statistics of the channels, measured frequency responses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from analysis.comparison.bode import MOST_FIGURES, SIZE, STYLES, Curve, bode_figures, labels
from analysis.comparison.responses import KNOWN, Entry, compared, entry_of
from analysis.comparison.table import Comparison, Part, Row, Value, rows_of
from analysis.identification.bode import curves_of_run
from analysis.pages.canvas import Canvas
from analysis.pages.formats import unit_text
from analysis.pages.quantities import scaled
from campaigns.log import Run, read_run
from campaigns.log.summary import summarise
from sim_backend.errors import MccdError
from sim_backend.readings import with_gaps

STATISTICS = ("mean", "std", "smallest", "largest")
SHOWN_S = 1.0
"""How much of two runs without a frequency response is drawn."""


def compare_runs(first: str, second: str) -> Comparison:
    """Return what differs between two logs; raises DataError for one that cannot be read."""
    with read_run(first) as one, read_run(second) as other:
        entries, why = _responses(one, other)
        units = _units(one, other)
        rows, remark = compared(entries, units)
        curves = (_drawn(entries[0], units), _drawn(entries[1], units))
        parts = (
            Part("Header", rows_of(_header(one), _header(other))),
            Part("Settings that differ", _settings(one.header.settings, other.header.settings)),
            Part("Channels", _channels(one, other)),
            Part("Frequency response", tuple(rows), why or remark),
        )
        moving = () if any(curves) else _over_time((first, second), (one, other))
    caption = f"Frequencies at which the response is known to {100.0 * KNOWN:g} %."
    figures = (*bode_figures((first, second), curves, caption, marker="."), *moving)
    return Comparison("run", (first, second), tuple(p for p in parts if p.rows or p.remark), figures)


def _over_time(names: tuple[str, str], runs: tuple[Run, Run]) -> tuple[Canvas, ...]:
    """Return a figure for every output of both: the first seconds of the last segment of each."""
    figures = []
    for output in [name for name in runs[0].names("output") if name in runs[1].names("output")][:MOST_FIGURES]:
        units = [run.channels[output].unit for run in runs]
        if units[0] != units[1]:
            continue
        title = f"{output} over time"
        canvas = Canvas(title, f"The first {SHOWN_S:g} s of the last segment, where there is one.", size=SIZE)
        parts = []
        for run in runs:
            start = run.segments[-1].start if run.segments else 0
            values = with_gaps(run.stored(output, start, min(start + round(SHOWN_S * run.sample_rate_hz), run.rows)))
            parts.append((np.arange(values.size) / run.sample_rate_hz, values))
        largest = max(float(np.nanmax(np.abs(y), initial=0.0)) for _, y in parts)
        factor, unit = scaled(largest, units[0])
        canvas.panel(0, output, "time in the segment (s)", f"{output} ({unit_text(unit)})")
        for name, style, (time_s, values) in zip(labels(names), STYLES, parts, strict=True):
            canvas.line(0, name, time_s, values * factor, **style)
        canvas.legend_outside(2)
        figures.append(canvas)
    return tuple(figures)


def _header(run: Run) -> dict[str, Value]:
    header = run.header
    return {
        "test": header.test,
        "bench": " ".join(text for text in header.bench.values() if text),
        "status": header.status,
        "note": header.note,
        "started (UTC)": datetime.fromisoformat(header.started_utc).astimezone(UTC).strftime("%Y-%m-%d %H:%M:%S"),
        "seed": None if header.seed is None else str(header.seed),
        "written by": f"mccd {header.tool_version}",
        "samples": run.rows,
        "sample rate (Hz)": run.sample_rate_hz,
        "segments": len(run.segments),
    }


def _settings(first: Mapping[str, Any], second: Mapping[str, Any]) -> tuple[Row, ...]:
    rows = rows_of({k: _plain(v) for k, v in first.items()}, {k: _plain(v) for k, v in second.items()})
    return tuple(row for row in rows if row.differs)


def _plain(value: Any) -> Value:
    if isinstance(value, bool) or value is None:
        return str(value).lower() if value is not None else None
    return value if isinstance(value, int | float | str) else str(value)


def _channels(one: Run, other: Run) -> tuple[Row, ...]:
    found = [{s.name: s for s in summarise(run)} if run.rows else {} for run in (one, other)]
    rows = []
    for name in dict.fromkeys(name for each in found for name in each):
        a, b = (each.get(name) for each in found)
        unit = " / ".join(dict.fromkeys(s.unit for s in (a, b) if s is not None))
        spoken = _spoken(one if name in one.channels else other, name)
        rows += [Row(f"{spoken}, {what}", getattr(a, what, None), getattr(b, what, None), unit) for what in STATISTICS]
    return tuple(rows)


def _responses(one: Run, other: Run) -> tuple[tuple[list[Entry], list[Entry]], str]:
    """Return what both measured by frequency, none and the reason where one holds too little for it."""
    entries: list[list[Entry]] = []
    for run in (one, other):
        try:
            found = curves_of_run(run)
        except MccdError as error:
            return ([], []), f"None is compared: {error}"
        if not found:
            return ([], []), f"None is compared: {run.path} holds no excitation that shows one."
        entries.append(
            [entry_of(replace(c, output=_spoken(run, c.output), input=_spoken(run, c.input))) for c in found]
        )
    return (entries[0], entries[1]), ""


def _drawn(entries: Sequence[Entry], units: Mapping[tuple[str, str], str]) -> list[Curve]:
    return [
        Curve(*entry.place, units.get(entry.place, ""), entry.curve.frequency_hz, entry.response)
        for entry in entries
        if entry.known.any()
    ]


def _spoken(run: Run, name: str) -> str:
    """Return the name of a channel with its axis apart, so that it is printed as one: command theta_x."""
    axis = run.channels[name].dof
    return f"{name.removesuffix(f'_{axis}')} {axis}" if axis and name.endswith(f"_{axis}") else name


def _units(*runs: Run) -> dict[tuple[str, str], str]:
    return {
        (_spoken(run, o), _spoken(run, i)): f"{run.channels[o].unit} per {run.channels[i].unit}"
        for run in runs
        for o in run.names("output")
        for i in run.names("input")
    }
