"""A table of the report: the paper's number, ours, the deviation, and whether it stays within what was stated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from analysis.paper.numbers import UNIT_SI, Label, PaperNumber, PaperTable


@dataclass(frozen=True)
class Ours:
    """Our value of one row in SI, its standard deviation where one is known, and a remark; infinite means never."""

    value: float
    std: float | None = None
    note: str = ""


@dataclass(frozen=True)
class Row:
    """One row, all numbers in the unit of the paper; `ours` is None where nothing was measured."""

    number: PaperNumber
    ours: float | None
    std: float | None = None
    note: str = ""

    @property
    def deviation(self) -> float | None:
        """Ours minus the paper's."""
        return None if self.ours is None or self.number.value is None else self.ours - self.number.value

    @property
    def ok(self) -> bool | None:
        """Whether ours agrees within the tolerance (below the bound, where the paper prints one); None if unknown."""
        deviation = self.deviation
        if deviation is None or math.isnan(deviation):
            return None
        # one part in 1e9 of the value is rounding of the conversion between units, no disagreement
        slack = self.number.tolerance + 1e-9 * abs(self.number.value or 0.0)
        return deviation <= slack if self.number.bound else abs(deviation) <= slack

    @property
    def met(self) -> bool | None:
        """Whether ours meets the paper's requirement; None where there is none or nothing was measured."""
        if self.number.requirement is None or self.ours is None:
            return None
        required = self.number.requirement
        return self.ours >= required if self.number.at_least else self.ours <= required

    @property
    def failed(self) -> bool:
        """Whether this is a prediction that lies outside its tolerance."""
        return self.number.label == "predicted" and self.ok is False


@dataclass(frozen=True)
class Table:
    """One finished table with the runs that it rests on."""

    key: str
    paper: PaperTable
    rows: tuple[Row, ...]
    run_uids: tuple[str, ...] = field(default=())

    def as_json(self) -> list[dict[str, Any]]:
        """Return the rows as the report's contract has them: row, paper, ours, unit, label, tolerance, ok."""
        return [
            {
                "row": r.number.row,
                "paper": r.number.value,
                "ours": _finite(r.ours),
                "unit": r.number.unit,
                "label": r.number.label,
                "tolerance": r.number.tolerance,
                "ok": r.ok,
            }
            for r in self.rows
        ]

    def frame(self) -> pd.DataFrame:
        """Return the table with every column, for CSV, LaTeX and HTML alike."""
        columns: dict[str, list[object]] = {
            "row": [r.number.row for r in self.rows],
            "requirement": [r.number.requirement for r in self.rows],
            "paper": [r.number.value for r in self.rows],
            "ours": [r.ours for r in self.rows],
            "std": [r.std for r in self.rows],
            "deviation": [r.deviation for r in self.rows],
            "unit": [r.number.unit for r in self.rows],
            "label": [r.number.label for r in self.rows],
            "tolerance": [r.number.tolerance for r in self.rows],
            "ok": [r.ok for r in self.rows],
            "why": [r.number.why for r in self.rows],
            "note": [r.note for r in self.rows],
        }
        if all(value is None for value in columns["requirement"]):
            del columns["requirement"]
        return pd.DataFrame(columns)


def build_table(key: str, paper: PaperTable, ours: Mapping[str, Ours | float], run_uids: tuple[str, ...] = ()) -> Table:
    """Return the table from our values in SI by row key; rows without one stay visible as not measured.

    Raises KeyError for a value whose key is no row, which is a mistake in the table's function.
    """
    unknown = sorted(set(ours) - {n.key for n in paper.rows})
    if unknown:
        raise KeyError(f"table {key} has no rows {unknown}")
    return Table(key, paper, tuple(_row(n, ours.get(n.key)) for n in paper.rows), run_uids)


def _row(number: PaperNumber, ours: Ours | float | None) -> Row:
    if ours is None:
        return Row(number, None)
    full = ours if isinstance(ours, Ours) else Ours(float(ours))
    si = UNIT_SI[number.unit]
    std = None if full.std is None else float(full.std / si)
    return Row(number, float(full.value / si), std, full.note)


def label_counts(tables: list[Table]) -> dict[Label, tuple[int, int, int]]:
    """Return for every label how many rows agree, how many do not, and how many are unknown."""
    counts: dict[Label, tuple[int, int, int]] = {}
    for label in ("input", "calibrated", "predicted"):
        oks = [r.ok for t in tables for r in t.rows if r.number.label == label]
        counts[label] = (oks.count(True), oks.count(False), oks.count(None))
    return counts


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
