"""Two runs side by side: headers, settings that differ, statistics of the channels, measured frequency responses."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

import numpy as np

from analysis.comparison.bode import MOST_FIGURES, SIZE, STYLES, Curve, bode_figures, labels
from analysis.comparison.table import Comparison, Part, Row, Value, beside, rows_of
from analysis.identification.bode import curves_of_run
from analysis.pages.canvas import Canvas
from analysis.pages.formats import unit_text
from analysis.pages.quantities import scaled
from campaigns.log import Run, read_run
from campaigns.log.summary import summarise
from sim_backend.errors import MccdError
from sim_backend.readings import with_gaps

STATISTICS = ("mean", "std", "smallest", "largest")
LINES = 400
"""Frequencies at which two responses are compared, spread evenly over the logarithm of what both have measured."""


SHOWN_S = 1.0
"""How much of two runs without a frequency response is drawn."""


def compare_runs(first: str, second: str) -> Comparison:
    """Return what differs between two logs; raises DataError for one that cannot be read."""
    with read_run(first) as one, read_run(second) as other:
        curves, why = _responses(one, other)
        parts = (
            Part("Header", rows_of(_header(one), _header(other))),
            Part("Settings that differ", _settings(one.header.settings, other.header.settings)),
            Part("Channels", _channels(one, other)),
            Part("Frequency response", _apart(curves, _units(one, other)), why),
        )
        moving = () if any(curves) else _over_time((first, second), (one, other))
    figures = (*bode_figures((first, second), curves), *moving)
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
        rows += [Row(f"{name}, {what}", getattr(a, what, None), getattr(b, what, None), unit) for what in STATISTICS]
    return tuple(rows)


def _responses(one: Run, other: Run) -> tuple[tuple[list[Curve], list[Curve]], str]:
    """Return what both measured by frequency, none and the reason where one holds too little for it."""
    curves: list[list[Curve]] = []
    units = _units(one, other)
    for run in (one, other):
        try:
            found = curves_of_run(run)
        except MccdError as error:
            return ([], []), f"None is compared: {error}"
        if not found:
            return ([], []), f"None is compared: {run.path} holds no excitation that shows one."
        curves.append(
            [
                Curve(
                    c.output,
                    c.input,
                    units.get((c.output, c.input), ""),
                    c.frequency_hz,
                    c.magnitude * np.exp(1j * c.phase_rad),
                )
                for c in found
            ]
        )
    return (curves[0], curves[1]), ""


def _units(*runs: Run) -> dict[tuple[str, str], str]:
    return {
        (o, i): f"{run.channels[o].unit} per {run.channels[i].unit}"
        for run in runs
        for o in run.names("output")
        for i in run.names("input")
    }


def _apart(curves: tuple[list[Curve], list[Curve]], units: Mapping[tuple[str, str], str]) -> tuple[Row, ...]:
    """Return, for every entry that both measured, the median magnitudes over the range that is common."""
    second = {(c.output, c.input): c for c in curves[1]}
    rows = []
    for a in curves[0]:
        b = second.get((a.output, a.input))
        if b is None or not (np.any(a.response) or np.any(b.response)):
            continue  # what nothing drives tells nothing
        low, high = (pick(a.frequency_hz, b.frequency_hz) for pick in (_low, _high))
        if not 0.0 < low < high < np.inf:
            continue
        f = np.geomspace(low, high, LINES)
        sizes = [np.interp(f, c.frequency_hz, np.abs(c.response)) for c in (a, b)]
        what = f"{a.input} → {a.output}, {low:.3g} to {high:.3g} Hz"
        medians = [float(np.median(size)) for size in sizes]
        rows.append(beside(f"{what}, median magnitude", medians, units.get((a.output, a.input), "")))
        peaks = [float(f[np.argmax(size)]) for size in sizes]
        rows.append(beside(f"{what}, largest at", peaks, "Hz"))
    return tuple(rows)


def _low(first: np.ndarray, second: np.ndarray) -> float:
    return float(max(first[first > 0.0].min(initial=np.inf), second[second > 0.0].min(initial=np.inf)))


def _high(first: np.ndarray, second: np.ndarray) -> float:
    return float(min(first.max(initial=0.0), second.max(initial=0.0)))
