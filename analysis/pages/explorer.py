"""What an interactive plot shows: choices, and for every combination of them panels of curves and a table of facts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.pages.canvas import thinned

Array = NDArray[np.float64]

POINTS = 1500
"""Longest curve on the page; longer ones keep the smallest and largest sample of every stretch."""

DIGITS = 6
"""Significant digits of the values that are drawn: finer than a pixel of a figure zoomed a thousand times."""

Kind = Literal["line", "points", "bars"]

Colour = Literal["", "ink", "quiet"]
"""Colour of a curve that belongs to no model: ink where it was measured, quiet for noise. Others follow the order."""


@dataclass(frozen=True)
class Series:
    """One named curve, its x rising for a line; colour and dash follow from its order unless it has a `colour`.

    A line has a gap where y is NaN.
    """

    name: str
    x: Array
    y: Array
    kind: Kind = "line"
    colour: Colour = ""

    @classmethod
    def of(
        cls, name: str, x: ArrayLike, y: ArrayLike, kind: Kind = "line", most: int = POINTS, colour: Colour = ""
    ) -> Self:
        """Return the series of arrays (n,), thinned to `most` points; what is not finite is left out."""
        xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        known = np.isfinite(xs) & np.isfinite(ys)
        return cls(name, *thinned(xs[known], ys[known], most), kind, colour)

    def as_json(self) -> dict[str, Any]:
        """Return the series as the page's script reads it."""
        drawn = {"name": self.name, "kind": self.kind, "x": _rounded(self.x), "y": _rounded(self.y)}
        return {**drawn, "colour": self.colour} if self.colour else drawn


@dataclass(frozen=True)
class Panel:
    """One pair of axes; `band` is the allowed range of y, or another in a `band_colour`.

    `y_range` is what is shown at first (default: all).

    With `names`, x counts them: 0 is the first.
    """

    x_label: str
    y_label: str
    series: tuple[Series, ...]
    log_x: bool = False
    band: tuple[float, float, str] | None = None
    y_range: tuple[float, float] | None = None
    log_y: bool = False
    names: tuple[str, ...] | None = None
    band_colour: Colour = ""

    def as_json(self) -> dict[str, Any]:
        """Return the panel as the page's script reads it."""
        return {
            "x": self.x_label,
            "y": self.y_label,
            "log": self.log_x,
            "log_y": self.log_y,
            "names": self.names,
            "band": self.band,
            **({"band_colour": self.band_colour} if self.band_colour else {}),
            "range": self.y_range,
            "series": [one.as_json() for one in self.series],
        }


@dataclass(frozen=True)
class Facts:
    """A small table of the numbers behind a view: what they are, and rows of a name and numbers (None: unknown).

    A bound is a text.
    """

    heads: tuple[str, ...]
    rows: tuple[tuple[str, tuple[float | str | None, ...]], ...]

    def as_json(self) -> dict[str, Any]:
        """Return {"heads": …, "rows": [[name, number …] …]}; what never ends or is unknown is null."""
        return {"heads": list(self.heads), "rows": [[name, *map(_finite, values)] for name, values in self.rows]}


@dataclass(frozen=True)
class View:
    """What one combination of choices shows: panels below one another over the same x, the facts, and a sentence."""

    panels: tuple[Panel, ...]
    facts: Facts
    note: str = ""


@dataclass(frozen=True)
class Explorer:
    """An interactive plot: `choices` maps what is chosen to its options, `views` the chosen options to their view."""

    key: str
    title: str
    remark: str
    choices: Mapping[str, tuple[str, ...]]
    views: Mapping[tuple[str, ...], View]
    run_uids: tuple[str, ...] = field(default=())

    def resting_on(self, run_uids: tuple[str, ...]) -> Self:
        """Return the same with the runs that it rests on."""
        return replace(self, run_uids=run_uids)

    def as_json(self) -> dict[str, Any]:
        """Return all views as the page's script reads them, each with the options that choose it."""
        return {
            "key": self.key,
            "choices": [{"name": name, "options": list(options)} for name, options in self.choices.items()],
            "views": [
                {
                    "chosen": list(chosen),
                    "panels": [p.as_json() for p in view.panels],
                    "facts": view.facts.as_json(),
                    "note": view.note,
                }
                for chosen, view in self.views.items()
            ],
        }


def _rounded(values: Array) -> list[float | None]:
    """Return values with DIGITS digits; a gap is None."""
    return [float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None for value in values]


def _finite(value: float | str | None) -> float | str | None:
    if isinstance(value, str):
        return value
    return None if value is None or not np.isfinite(value) else float(value)
