"""Bode diagrams of two over each other, an entry each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from analysis.pages.bode import PHASES_DEG, bode_canvas, draw_response, scale_axes
from analysis.pages.canvas import COLOURS, Canvas
from sim_backend.linear import Array

STYLES: Final[tuple[dict[str, Any], dict[str, Any]]] = (
    {"color": COLOURS[0], "linewidth": 1.4},
    {"color": COLOURS[1], "linewidth": 1.4, "linestyle": (0, (4, 2))},
)
"""The first and the second, apart by their dashes as well as by their colours."""

SIZE: Final = (5.2, 4.2)
"""Small enough to be read on a telephone."""

MOST_FIGURES = 12
"""Entries that are drawn, those of both first: of a large bench there are hundreds."""


@dataclass(frozen=True)
class Curve:
    """A complex response (n_f,) from `input` to `output` in `unit`, at frequencies (n_f,) in Hz."""

    output: str
    input: str
    unit: str
    frequency_hz: Array
    response: NDArray[np.complex128]


def bode_figures(
    names: tuple[str, str], curves: tuple[Sequence[Curve], Sequence[Curve]], caption: str = "", **style: Any
) -> tuple[Canvas, ...]:
    """Return a figure of magnitude and phase for every entry that either has, its curves in a `style` besides STYLES.

    A response is not drawn where it is NaN.
    """
    # an entry that nothing drives has no magnitude to draw
    by_place = [{(one.output, one.input): one for one in each if np.any(one.response)} for each in curves]
    places = list(dict.fromkeys(place for each in by_place for place in each))
    places.sort(key=lambda place: not all(place in each for each in by_place))
    figures = []
    for place in places[:MOST_FIGURES]:
        output, source = place
        drawn = [each.get(place) for each in by_place]
        unit = next(one.unit for one in drawn if one is not None)
        canvas = bode_canvas(f"Response {source} → {output}", f"{source} → {output}", unit, SIZE)
        canvas.caption = caption
        for name, own, one in zip(labels(names), STYLES, drawn, strict=True):
            if one is not None:
                draw_response(canvas, name, one.frequency_hz, one.response, **own, **style)
        scale_axes(canvas)
        canvas.axes[1].set_yticks(PHASES_DEG)
        canvas.legend_outside(2)
        figures.append(canvas)
    return tuple(figures)


def labels(names: tuple[str, str]) -> tuple[str, str]:
    """Return short names for a legend: the last parts of the paths that differ."""
    short = [name.rstrip("/").rpartition("/")[2] for name in names]
    return (short[0], short[1]) if short[0] != short[1] else (f"A: {short[0]}", f"B: {short[1]}")
