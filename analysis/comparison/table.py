"""What a comparison is: tables of values side by side, and curves over each other."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from analysis.pages.canvas import Canvas
from analysis.pages.formats import NONE, readable, shown, unit_text
from sim_backend.effects.words import with_effects

Value = float | int | str | None

SAME = 1e-9
"""Relative difference below which numbers are the same: what rounding in a computed one leaves."""


@dataclass(frozen=True)
class Row:
    """One value of both, in `unit`; None where one does not have it. `std` are standard deviations where known."""

    what: str
    first: Value
    second: Value
    unit: str = ""
    std: tuple[float | None, float | None] = (None, None)

    @property
    def difference(self) -> float | None:
        """The second minus the first, None unless both are numbers."""
        if isinstance(self.first, str) or isinstance(self.second, str) or self.first is None or self.second is None:
            return None
        return float(self.second) - float(self.first)

    @property
    def sigmas(self) -> float | None:
        """The difference in its standard deviations, where both are known."""
        stds = [std for std in self.std if std is not None and math.isfinite(std)]
        if self.difference is None or len(stds) < 2 or not math.hypot(*stds):
            return None
        return abs(self.difference) / math.hypot(*stds)

    @property
    def differs(self) -> bool:
        """Whether the values are not the same."""
        if self.difference is None or self.first is None or self.second is None:
            return self.first != self.second
        if not math.isfinite(self.difference):  # of one that is no finite number, or of both
            return self.first != self.second and not (_is_nan(self.first) and _is_nan(self.second))
        return abs(self.difference) > SAME * max(abs(float(self.first or 0.0)), abs(float(self.second or 0.0)))

    @property
    def marked(self) -> bool:
        """Whether the values differ, by more than two standard deviations where these are known."""
        return self.differs and (self.sigmas is None or self.sigmas > 2.0)

    def texts(self) -> tuple[str, str, str, str, str]:
        """Return what people read: the value, both numbers, their difference and the unit."""
        change = self.difference
        whole = isinstance(self.first, int) and isinstance(self.second, int)
        told = (
            ""
            if change is None or not math.isfinite(change) or not self.differs
            else f"{change:.0f}".replace("-", "−")
            if whole
            else shown(change)
        )
        if told and self.first:
            relative = readable(100.0 * (change or 0.0) / abs(float(self.first)))
            told += f" ({relative if relative.startswith('−') else f'+{relative}'} %)"
        if self.sigmas is not None:
            told += f" = {readable(self.sigmas, 2)} σ" if told else ""
        unit = unit_text(self.unit)
        first, second = _text(self.first, self.std[0]), _text(self.second, self.std[1])
        return with_effects(self.what), with_effects(first), with_effects(second), told, unit

    def as_json(self) -> dict[str, Any]:
        """Return the row as JSON can hold it; numbers that are not finite are None."""
        first, second = (_finite(value) for value in (self.first, self.second))
        stds = [_finite(std) for std in self.std]
        told = {"what": self.what, "first": first, "second": second, "unit": self.unit}
        return told | {"std": stds, "difference": _finite(self.difference), "sigmas": _finite(self.sigmas)}


@dataclass(frozen=True)
class Part:
    """One table of a comparison; `remark` says what is to be known of it, or why it is empty."""

    title: str
    rows: tuple[Row, ...]
    remark: str = ""


@dataclass(frozen=True)
class Comparison:
    """Two of a `kind` (run, model, diagnosis) by their names: tables and figures."""

    kind: str
    names: tuple[str, str]
    parts: tuple[Part, ...]
    figures: tuple[Canvas, ...] = field(default=())

    def as_json(self) -> dict[str, Any]:
        """Return everything but the figures."""
        parts = [
            {"title": part.title, "remark": part.remark, "rows": [row.as_json() for row in part.rows]}
            for part in self.parts
        ]
        return {"kind": self.kind, "first": self.names[0], "second": self.names[1], "parts": parts}


def beside(what: str, values: Iterable[Value], unit: str = "", std: Iterable[float | None] = (None, None)) -> Row:
    """Return the row of two values, with their standard deviations where they are known."""
    first, second = values
    first_std, second_std = std
    return Row(what, first, second, unit, (first_std, second_std))


def rows_of(first: dict[str, Value], second: dict[str, Value]) -> tuple[Row, ...]:
    """Return a row for every name of either, in their order."""
    names: Sequence[str] = [*first, *(name for name in second if name not in first)]
    return tuple(Row(name, first.get(name), second.get(name)) for name in names)


def _text(value: Value, std: float | None) -> str:
    if value is None:
        return NONE
    if isinstance(value, str):
        return value
    if not math.isfinite(value):
        return "NaN" if _is_nan(value) else f"{'-' if value < 0 else ''}∞"
    told = shown(float(value), None, std) if not isinstance(value, int) else str(value)
    return f"{told} ± {readable(std, 2)}" if std is not None and math.isfinite(std) and std > 0.0 else told


def _is_nan(value: Value) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _finite(value: Value) -> Value:
    return None if isinstance(value, float) and not math.isfinite(value) else value
