"""The figure with which the page of a diagnosis opens: measured and simulated over each other, where it tells most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analysis.diagnosis.answer.figures import (
    AFTER,
    BEFORE,
    GIVEN,
    MEASURED,
    MOST_POINTS,
    SCALED_APART,
    SWINGS,
    WIDE,
    Drawn,
    swing_rows,
)
from analysis.diagnosis.evidence.as_given import left_as_given
from analysis.diagnosis.records.dataset import Dataset, Window
from analysis.pages.canvas import Canvas, thinned
from analysis.pages.quantities import scaled
from sim_backend.axis_names import axis_text
from sim_backend.linear import Array
from sim_backend.model import Model

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST_ROWS = 200
"""Samples of the shortest stretch that is drawn."""


@dataclass(frozen=True)
class _Stretch:
    """Samples of one output of one record."""

    record: int
    window: Window
    output: int
    rows: slice


def opening_figure(
    data: Dataset,
    before: Sequence[Array],
    after: Sequence[Array],
    noise_rms: Array,
    model: Model,
) -> Drawn | None:
    """Return measured and simulated over each other where the extended model gains most, held-out samples if there are.

    Where the two models are one it is where that misses most. The model as given is drawn too, unless it runs away.

    `before` and `after` are each record's residuals (n, n_y), `noise_rms` has shape (n_y,). None without a window.
    """
    place = _telling(data, before, after, noise_rms)
    if place is None:
        return None
    record, port = data.records[place.record], model.outputs[place.output]
    y = record.y[place.rows, place.output]
    old, new = (x[place.record][place.rows, place.output] for x in (before, after))
    untouched = left_as_given(model, [record], data.rate_hz)[0][place.rows, place.output]
    found = [] if np.array_equal(old, new) else [("extended", new, AFTER)]
    first = [("as given", untouched, GIVEN)] if np.all(np.isfinite(untouched)) else []
    curves = [*first, ("adjusted", old, BEFORE), *found]
    time_s = (np.arange(place.rows.start, place.rows.stop) - place.window.start) / data.rate_hz
    name = axis_text(port.dof)
    # a rigid body, played from rest, runs away
    seen = float(np.max(np.abs(y - y.mean())))
    most = min(max(float(np.max(np.abs(left))) for _, left, _ in curves), 2.0 * seen)
    two_sigma = 2.0 * float(noise_rms[place.output])
    least = max(float(np.max(np.abs(curves[-1][1]))), two_sigma)
    apart = len(curves) > 1 and SCALED_APART * least < most
    rows = 3 if apart else 2
    canvas = Canvas(f"Measured and simulated, {name}", "", rows=rows, size=(WIDE, 1.0 + 1.15 * rows), share_x=True)
    size, unit = scaled(float(np.max(np.abs(y))), port.unit)
    canvas.panel(0, name, "", f"position ({unit})" if port.unit in ("rad", "m") else f"output ({unit})")
    canvas.line(0, "measured", *thinned(time_s, y * size, MOST_POINTS), color=MEASURED, linewidth=2.2)
    for label, left, colour in curves:
        canvas.line(0, label, *thinned(time_s, (y - left) * size, MOST_POINTS), color=colour, linewidth=1.0)
    _within(canvas.axes[0], (float(y.min()) - seen) * size, (float(y.max()) + seen) * size)
    parts = [(curves[:-1], most), (curves[-1:], least)] if apart else [(curves, most)]
    for i, (own, largest) in enumerate(parts, start=1):
        factor, small = scaled(largest, port.unit)
        canvas.panel(i, "", "time in the segment (s)" if i == len(parts) else "", f"residual ({small})")
        for label, left, colour in own:
            canvas.line(i, label, *thinned(time_s, left * factor, MOST_POINTS), color=colour, linewidth=0.9)
        if i == len(parts):
            canvas.band(i, -two_sigma * factor, two_sigma * factor, "noise floor, ±2σ")
        _within(canvas.axes[i], -1.1 * largest * factor, 1.1 * largest * factor)
    canvas.legend_outside()
    unseen = ", which no fit has seen" if place.window.held_out else ""
    where = "the extended model gains most on the adjusted one" if found else "the adjusted model misses most"
    caption = (
        f"{name} in segment “{place.window.label}”{unseen}: the stretch where {where}. “As given” is the model with "
        "the numbers of its file, played from rest; “adjusted” is the same with its own numbers fitted."
        f"{' The lowest panel has another scale.' if apart else ''}"
    )
    return Drawn("measured-and-simulated", canvas.title, caption, canvas)


def _telling(data: Dataset, before: Sequence[Array], after: Sequence[Array], noise_rms: Array) -> _Stretch | None:
    """Return where the extended model gains most in units of the noise, a few swings of the output long.

    Where nothing was added it is where the adjusted model misses most.
    """
    windows = data.judged
    if not windows:
        return None
    gains = [b**2 - a**2 for b, a in zip(before, after, strict=True)]
    if not any(np.any(gain > 0.0) for gain in gains):
        gains = [b**2 for b in before]
    size = np.where(noise_rms > 0.0, noise_rms, 1.0)
    gained = [np.mean(gains[i][w.start : w.stop] / size**2, axis=0) for i, w in windows]
    at = int(np.argmax([float(np.max(one)) for one in gained]))
    (i, w), o = windows[at], int(np.argmax(gained[at]))
    y = data.records[i].y[w.start : w.stop, o]
    length = min(max(SWINGS * swing_rows(y), LEAST_ROWS), y.size)
    total = np.concatenate([[0.0], np.cumsum(gains[i][w.start : w.stop, o])])
    begin = w.start + int(np.argmax(total[length:] - total[:-length]))
    return _Stretch(i, w, o, slice(begin, begin + length))


def opening_output(data: Dataset, before: Sequence[Array], after: Sequence[Array], noise_rms: Array) -> int:
    """Return the number of the output that the opening shows; the first where there is nothing to show.

    Residuals are (n, n_y) per record, `noise_rms` (n_y,) in units of the outputs.
    """
    place = _telling(data, before, after, noise_rms)
    return 0 if place is None else place.output


def _within(axes: Axes, low: float, high: float) -> None:
    """Show no more of an axis than from `low` to `high`."""
    bottom, top = axes.get_ylim()
    axes.set_ylim(max(bottom, low), min(top, high))
