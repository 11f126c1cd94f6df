"""A table of the report: the paper's number, ours, the deviation, and whether it stays within what was stated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

from analysis.paper.numbers import UNIT_SI, Label, PaperNumber, PaperTable

if TYPE_CHECKING:
    import pandas as pd


SURE = 0.95
"""Share of repeats that have to agree with the paper, or to differ from it, for one of them to say which."""


@dataclass(frozen=True)
class Ours:
    """Our value of one row in SI, its standard deviation where one is known, and a remark; infinite means never.

    `share` is the share of repeats with other noise that agree with the paper, where a study has counted them.
    """

    value: float
    std: float | None = None
    note: str = ""
    share: float | None = None


@dataclass(frozen=True)
class Row:
    """One row, all numbers in the unit of the paper; `ours` is None where nothing was measured.

    `ours` is what the paper's controllers achieve here, `own` what this project's design does, None where it was not
    played. `counted` is the share of repeats that agree, where a study has counted them.
    """

    number: PaperNumber
    ours: float | None
    std: float | None = None
    note: str = ""
    own: float | None = None
    own_std: float | None = None
    counted: float | None = None

    @property
    def deviation(self) -> float | None:
        """Ours minus the paper's."""
        return None if self.ours is None or self.number.value is None else self.ours - self.number.value

    @property
    def ok(self) -> bool | None:
        """Whether ours agrees within the tolerance; None if unknown, or a bound that is kept: that is not agreement."""
        return None if self.inside and self.number.label == "bound" else self.inside

    @property
    def inside(self) -> bool | None:
        """Whether ours lies within the tolerance (below it, where the paper prints an upper bound); None if unknown."""
        deviation = self.deviation
        if deviation is None or math.isnan(deviation) or not self.determined:
            return None
        # one part in 1e9 of the value is rounding of the conversion between units, no disagreement
        slack = self.number.tolerance + 1e-9 * abs(self.number.value or 0.0)
        return deviation <= slack if self.number.upper else abs(deviation) <= slack

    @property
    def determined(self) -> bool:
        """Whether ours can be compared with the paper's: known better than its own size, or than the tolerance.

        An upper bound is met or not however small ours is. Nothing is determined by noise that might as well have given
        the other answer.
        """
        return self._known_well and not self.noisy

    @property
    def _known_well(self) -> bool:
        if self.ours is None or self.std is None or self.number.upper:
            return True
        return self.std < abs(self.ours) or self.std <= self.number.tolerance

    @property
    def share(self) -> float | None:
        """Share of repeats with other noise that lie within the tolerance; None where no scatter is known.

        It was counted, or follows from the standard deviation, taken as that of Gaussian noise about ours.
        """
        deviation = self.deviation
        if self.counted is not None or not self.std or deviation is None or not math.isfinite(deviation / self.std):
            return self.counted
        above = _gaussian((self.number.tolerance - deviation) / self.std)
        below = 0.0 if self.number.upper else _gaussian((-self.number.tolerance - deviation) / self.std)
        return above - below

    @property
    def noisy(self) -> bool:
        """Whether the noise decides if ours agrees: neither answer is that of nearly every repeat."""
        return self._known_well and self.share is not None and 1.0 - SURE < self.share < SURE

    @property
    def met(self) -> bool | None:
        """Whether ours meets the paper's requirement; None where there is none or nothing was measured."""
        return self._meets(self.ours)

    @property
    def paper_met(self) -> bool | None:
        """Whether the paper's own number meets its requirement; None as `met`."""
        return self._meets(self.number.value)

    @property
    def own_met(self) -> bool | None:
        """Whether this project's design meets the requirement; None as `met`."""
        return self._meets(self.own)

    def _meets(self, value: float | None) -> bool | None:
        required = self.number.requirement
        if required is None or value is None:
            return None
        return value >= required if self.number.at_least else value <= required

    @property
    def own_worse(self) -> bool:
        """Whether this project's design is farther on the bad side of a requirement than the paper's controllers here.

        What noise alone could make of equal numbers counts for nothing.
        """
        if self.number.requirement is None or self.own is None or self.ours is None:
            return False
        more = (self.ours - self.own) if self.number.at_least else (self.own - self.ours)
        return more > 2.0 * math.hypot(self.std or 0.0, self.own_std or 0.0)

    @property
    def missed(self) -> bool:
        """Whether ours does not agree, whatever the label: outside of the tolerance, or so that the noise decides."""
        return self.ok is False or (self.ours is not None and not self.determined)

    @property
    def failed(self) -> bool:
        """Whether this is a prediction or a bound that lies outside its tolerance."""
        return self.number.label in ("predicted", "bound") and self.ok is False


@dataclass(frozen=True)
class Table:
    """One finished table with the runs that it rests on."""

    key: str
    paper: PaperTable
    rows: tuple[Row, ...]
    run_uids: tuple[str, ...] = field(default=())

    @property
    def compared(self) -> bool:
        """Whether this project's own design stands beside the paper's controllers."""
        return any(r.own is not None for r in self.rows)

    def as_json(self) -> list[dict[str, Any]]:
        """Return the rows as the report's contract has them: row, paper, ours, unit, label, tolerance, ok.

        A table that compares has `this_project` as well.
        """
        return [
            {
                "row": r.number.row,
                "paper": r.number.value,
                "ours": _finite(r.ours),
                "unit": r.number.unit,
                "label": r.number.label,
                "tolerance": r.number.tolerance,
                "ok": r.ok,
                **({"this_project": _finite(r.own)} if self.compared else {}),
            }
            for r in self.rows
        ]

    def frame(self) -> pd.DataFrame:
        """Return the table with every column, for CSV, LaTeX and HTML alike."""
        import pandas as pd

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
            "chosen": [r.number.chosen for r in self.rows],
            "seen": [r.number.seen for r in self.rows],
            "note": [r.note for r in self.rows],
        }
        if self.compared:
            columns["this_project"] = [r.own for r in self.rows]
            columns["this_project_std"] = [r.own_std for r in self.rows]
        for name in ("requirement", "chosen", "seen"):
            if not any(columns[name]):
                del columns[name]
        return pd.DataFrame(columns)


def build_table(
    key: str,
    paper: PaperTable,
    ours: Mapping[str, Ours | float],
    run_uids: tuple[str, ...] = (),
    own: Mapping[str, Ours | float] | None = None,
) -> Table:
    """Return the table from our values in SI by row key; rows without one stay visible as not measured.

    `own` are those of this project's design.

    Raises KeyError for a value whose key is not a row, which is a mistake in the table's function.
    """
    more = own or {}
    unknown = sorted((set(ours) | set(more)) - {n.key for n in paper.rows})
    if unknown:
        raise KeyError(f"table {key} has no rows {unknown}")
    return Table(key, paper, tuple(_row(n, ours.get(n.key), more.get(n.key)) for n in paper.rows), run_uids)


def _row(number: PaperNumber, ours: Ours | float | None, own: Ours | float | None) -> Row:
    value, std, note = _in_unit(number, ours)
    own_value, own_std, _ = _in_unit(number, own)
    return Row(number, value, std, note, own_value, own_std, ours.share if isinstance(ours, Ours) else None)


def _in_unit(number: PaperNumber, ours: Ours | float | None) -> tuple[float | None, float | None, str]:
    if ours is None:
        return None, None, ""
    full = ours if isinstance(ours, Ours) else Ours(float(ours))
    si = UNIT_SI[number.unit]
    return float(full.value / si), None if full.std is None else float(full.std / si), full.note


class Count(NamedTuple):
    """How many rows lie within their tolerance and outside, of how many the noise decides, how many are unknown."""

    within: int
    outside: int
    noisy: int
    unknown: int

    @property
    def compared(self) -> int:
        """How many rows have a number of ours beside the paper's."""
        return self.within + self.outside + self.noisy


def label_counts(tables: list[Table]) -> dict[Label, Count]:
    """Return the count of every label.

    A folded table holds the numbers of another one, and a row may repeat one: neither is counted again.
    """
    counts: dict[Label, Count] = {}
    for label in get_args(Label):
        rows = [r for t in tables if not t.paper.folded for r in t.rows if r.number.label == label]
        rows = [r for r in rows if not r.number.repeats]
        found = [r.inside for r in rows]
        noisy = sum(r.noisy for r in rows)
        counts[label] = Count(found.count(True), found.count(False), noisy, found.count(None) - noisy)
    return counts


def _gaussian(x: float) -> float:
    """Share of a standard normal distribution below `x`."""
    return 0.5 * (1.0 + math.erf(x / math.sqrt(2.0)))


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
