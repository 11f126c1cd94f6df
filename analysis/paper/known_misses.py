"""Reviewed misses of a report: table, row and reason, compared with what is measured now."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from analysis.paper.numbers import paper_tables
from analysis.paper.rows import Row, Table
from sim_backend.documents import read_text, toml_of
from sim_backend.errors import ConfigError, did_you_mean

Known = Mapping[tuple[str, str], str]
"""The reason of every known miss, by table and row."""

CHECKED = ("predicted", "bound")
"""Labels of numbers that can fail: the others were copied or set to match."""

State = Literal["passed", "failed", "known miss", "passes now", "not measured"]


@dataclass(frozen=True)
class Outcome:
    """What became of one number that can fail: its table, its row, and a sentence where it did not simply pass."""

    table: str
    row: str
    state: State
    said: str = ""


def load_known_misses(path: Path) -> Known:
    """Return the known misses in a TOML file: a table for each table of the report, in it `"row" = "reason"`.

    Raises ConfigError for a table or a row that the report does not have, one that was copied or set to match and so
    never fails, and an entry without a reason.
    """
    known: dict[tuple[str, str], str] = {}
    for key, rows in toml_of(read_text(path, "list of known misses"), str(path)).items():
        tables = paper_tables()
        if key not in tables or not isinstance(rows, dict):
            raise ConfigError(f"{path}: there is no table '{key}'; a report has {', '.join(tables)}")
        labels = {number.row: number.label for number in tables[key].rows}
        for row, reason in rows.items():
            if row not in labels:
                raise ConfigError(
                    f"{path}: table {key} has no row '{row}'; {did_you_mean(row, labels)}`mccd report --check` prints "
                    "the rows as they are written here"
                )
            if labels[row] not in CHECKED:
                raise ConfigError(f"{path}: table {key}, {row} is labelled {labels[row]} and never fails; remove it")
            if not (isinstance(reason, str) and reason.strip()):
                raise ConfigError(f"{path}: table {key}, {row} has no reason; write one as text")
            known[key, row] = reason
    return known


def outcomes(tables: Mapping[str, Table], known: Known) -> tuple[Outcome, ...]:
    """Return what became of every number that can fail, in the order of the report."""
    return tuple(
        _outcome(key, row, known.get((key, row.number.row)))
        for key, table in tables.items()
        for row in table.rows
        if row.number.label == "predicted"
        or (row.number.label in CHECKED and (row.inside is not None or not row.determined))
    )


def _outcome(key: str, row: Row, reason: str | None) -> Outcome:
    name = row.number.row
    if row.inside is None and row.determined:
        return Outcome(key, name, "not measured", "not measured by this campaign")
    if row.inside:
        return Outcome(key, name, "passed" if reason is None else "passes now")
    # a prediction that its own noise hides is no more confirmed than one that is missed
    said = _missed(row) if row.determined else f"not determined by this campaign{_uncertain(row)}"
    return (
        Outcome(key, name, "failed", said) if reason is None else Outcome(key, name, "known miss", f"{said}: {reason}")
    )


def _uncertain(row: Row) -> str:
    std = "" if row.std is None else f" ± {row.std:.3g}"
    share = f", about {100.0 * row.share:.0f} % of repeats agree" if row.noisy and row.share is not None else ""
    ours = f"{row.ours:.3g}{std} {row.number.unit}".rstrip()
    return f" ({ours}{share}); repeat it, or list it as known"


def _missed(row: Row) -> str:
    number = row.number
    ours = "never" if row.ours == float("inf") else f"{row.ours:.6g} {number.unit}".rstrip()
    allowed = f"at most {number.tolerance:g} above" if number.upper else f"within {number.tolerance:g} of"
    return f"{ours}, not {allowed} {number.value:g} {number.unit}".rstrip()
