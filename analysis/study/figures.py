"""The figure of a study: what changes along the sweep of a number, or without one how the numbers are distributed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from analysis.pages.canvas import COLOURS, PAPER, Canvas, look
from analysis.study.definition import Swept
from analysis.study.kinds import Column
from analysis.study.store import Store
from analysis.study.summary import Point, Share, Summary
from analysis.study.trial import Job

MOST_SERIES = 2 * len(COLOURS)
"""Most curves in a panel; the figure says how many more there are."""

ENTRY_IN = 0.2
"""Height of an entry of the legend above the panels, where curves are too many for one inside."""

SHOWN = {"_s": (1e3, "ms"), "_rad": (1e6, "µrad"), "_m": (1e6, "µm")}
"""How a figure shows a result by the unit that its name ends in; others as they are."""

FAR = 3.0
"""A limit that is farther from the numbers than so many times their span is written instead of drawn."""

_WIDE = 2


def study_figure(job: Job, store: Store, summary: Summary) -> Canvas:
    """Return the figure: one panel for every number and flag, one look for each point, or series of points."""
    shown = [c for c in job.columns if c.kind != "text"]
    columns = min(_WIDE, len(shown))
    rows = -(-len(shown) // columns)
    along = _swept_number(job)
    series = _series(along, summary)
    above_in = ENTRY_IN * min(len(series), MOST_SERIES + 1) if len(series) > len(COLOURS) else 0.0
    canvas = Canvas(
        title=job.study.title or job.study.name,
        caption="",
        rows=rows,
        columns=columns,
        size=(4.4 * columns, 3.1 * rows + above_in),
    )
    for i, column in enumerate(shown):
        if along is None:
            _distribution(canvas, i, column, job, store, summary)
        else:
            _curve(canvas, i, column, along, series)
    # shares of points that no number is swept along have one look: the points are counted along the axis
    named = (i for i, column in enumerate(shown) if along is not None or column.kind != "flag")
    _legend(canvas, next(named, None), len(series))
    for axes in canvas.axes[len(shown) :]:
        axes.set_visible(False)
    return canvas


def _swept_number(job: Job) -> str | None:
    """Return the first place that is swept over three numbers or more."""
    for one in job.study.vary:
        values = one.sweep or []
        if len(values) > 2 and all(isinstance(v, int | float) and not isinstance(v, bool) for v in values):
            return one.place
    return None


def _series(along: str | None, summary: Summary) -> dict[str, list[Point]]:
    """Return the points that one curve shows, by its name: those along the swept number, else each alone."""
    found: dict[str, list[Point]] = {}
    for point in summary.points:
        found.setdefault(_label({place: value for place, value in point.at.items() if place != along}), []).append(
            point
        )
    return found


def _legend(canvas: Canvas, i: int | None, series: int) -> None:
    """Name the curves: on panel `i` where they are few, else above all; say how many are not drawn."""
    if i is None or series < 2:
        return
    if series > MOST_SERIES:
        canvas.axes[i].plot([], [], " ", label=f"and {series - MOST_SERIES} more, in study.json")
    if series <= len(COLOURS):
        canvas.legend(i, loc="best")
    else:
        canvas.legend_outside()


def _label(at: Mapping[str, Swept]) -> str:
    return ", ".join(f"{place.rpartition('.')[2]} {value}" for place, value in at.items()) or "all trials"


def _scale(column: Column) -> tuple[float, str]:
    """Return the factor by which a figure shows a result, and the label of its axis."""
    for ending, (factor, unit) in SHOWN.items():
        if column.name.endswith(ending):
            return factor, f"{column.name.removesuffix(ending).replace('_', ' ')} ({unit})"
    return 1.0, column.name


def _limit(column: Column, drawn: ArrayLike) -> tuple[float | None, str]:
    """Return where the limit is drawn, None where it would press the numbers flat, and what the label then says."""
    known = np.asarray(drawn, dtype=float)
    known = known[np.isfinite(known)]
    if column.limit is None or not known.size:
        return None, ""
    at = column.limit * _scale(column)[0]
    low, high = float(known.min()), float(known.max())
    near = low - FAR * (high - low) <= at <= high + FAR * (high - low)
    return (at, "") if near else (None, f", limit {at:g}")


def _distribution(canvas: Canvas, i: int, column: Column, job: Job, store: Store, summary: Summary) -> None:
    """Draw the share of trials below each value; trials that came to nothing, or to infinity, keep it below 1."""
    flag = column.kind == "flag"
    points = summary.points if flag else summary.points[:MOST_SERIES]
    factor, label = _scale(column)
    values = np.empty((0, len(points)))
    if not flag:
        values = factor * store.numbers(column.name, job.study.total).reshape(-1, len(summary.points))
    limit, words = _limit(column, values[:, : len(points)])
    axes = canvas.panel(i, column.about, "point" if flag else label + words, "share of trials")
    if flag:
        shares = [p.flags[column.name] for p in points]
        _whiskers(canvas, i, "share and 95 % interval", list(range(len(points))), shares, look(0))
        axes.set_ylim(-0.03, 1.03)
        return
    for p, point in enumerate(points):
        ended = point.done + point.failed + point.broken
        known = np.sort(values[np.isfinite(values[:, p]), p])
        share = np.arange(1, known.size + 1) / max(ended, 1)
        canvas.line(i, _label(point.at), known, share, **(look(p) | {"marker": ""}), drawstyle="steps-post")
    if limit is not None:
        axes.axvline(limit, color=PAPER, linestyle="--", linewidth=0.8)
    axes.set_ylim(0.0, 1.03)
    axes.locator_params(axis="x", nbins=6)


def _curve(canvas: Canvas, i: int, column: Column, along: str, series: Mapping[str, Sequence[Point]]) -> None:
    """Draw the median with its 5 to 95 % band, or a share with its interval, over the swept number."""
    every = [p for points in series.values() for p in points]
    flag = column.kind == "flag"
    factor, label = _scale(column)
    shown = [q for p in every if not flag for q in p.numbers[column.name].quantiles.values()]
    limit, words = _limit(column, [factor * q for q in shown])
    axes = canvas.panel(i, column.about, along.rpartition(".")[2], "share of trials" if flag else label + words)
    for k, (name, points) in enumerate(list(series.items())[:MOST_SERIES]):
        style = look(k)
        x = [float(p.at[along]) for p in points]
        if flag:
            _whiskers(canvas, i, name, x, [p.flags[column.name] for p in points], style)
            continue
        low, middle, high = (
            [factor * _finite(p.numbers[column.name].quantiles[q]) for p in points] for q in ("q05", "median", "q95")
        )
        canvas.line(i, name, x, middle, **style, markersize=3)
        axes.fill_between(x, low, high, color=style["color"], alpha=0.15, linewidth=0)
    if flag:
        axes.set_ylim(-0.03, 1.03)
    elif limit is not None:
        axes.axhline(limit, color=PAPER, linestyle="--", linewidth=0.8)
    swept = [abs(float(p.at[along])) for p in every if p.at[along]]
    if swept and max(swept) > 30.0 * min(swept):
        axes.set_xscale("symlog", linthresh=min(swept))
        if all(float(p.at[along]) >= 0.0 for p in every):
            axes.set_xlim(-0.3 * min(swept), 1.4 * max(swept))


def _whiskers(
    canvas: Canvas, i: int, name: str, x: Sequence[float], shares: Sequence[Share], style: dict[str, Any]
) -> None:
    fraction = [s.fraction for s in shares]
    canvas.line(i, name, x, fraction, **style, markersize=3)
    for at, share in zip(x, shares, strict=True):
        canvas.axes[i].plot([at, at], share.ci95, color=style["color"], linewidth=1.0)


def _finite(value: float) -> float:
    return value if math.isfinite(value) else math.nan
