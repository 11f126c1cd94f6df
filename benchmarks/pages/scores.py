"""The table of blind scores in docs/diagnosis-limits.md, from what `mccd challenge score` writes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.pages.marks import link, percent


@dataclass(frozen=True)
class _Row:
    """A row: what the page calls a measure, and its name in the file."""

    words: str
    measure: str
    low: float | None = None
    """The share that the second generator is to reach; None where the file states the target."""


ROWS = (
    _Row(
        "one effect at 2 × its naming limit or more: named",
        "named correctly, one effect at >= 2 x its naming limit",
        0.9,
    ),
    _Row("a wrong name, over all cases", "confident wrong name"),
    _Row("nothing hidden, and not *consistent*", "false alarms on null campaigns"),
    _Row("a law that the library lacks: *unknown*", "laws that no library lists: unknown"),
    _Row("two effects: both named", "two effects at once, both named"),
    _Row("a changed law of a listed effect: named, nothing else", "listed with a twist: named and nothing else", 0.85),
    _Row("parameters within 2 σ", "parameters within 2 sigma"),
    _Row("names that are right, of all names", "names that are right"),
)
"""The measures of the page, in its order; two have a target of the second generator's own."""


def table(files: Sequence[Path]) -> str:
    """Return the scores of one file as Markdown, with what each is of and where the targets come from.

    Raises ValueError unless there is one file, and it holds a score of the second generator with every measure.
    """
    if len(files) != 1:
        raise ValueError(f"the table of scores is of one version, so it is made of one file; {len(files)} were given")
    (file,) = files
    found = json.loads(file.read_text(encoding="utf-8"))
    measures = {m["name"]: m for m in found["measures"]}
    missing = [row.measure for row in ROWS if row.measure not in measures]
    if missing:
        raise ValueError(f"{file.name} has no measure '{missing[0]}'; give a score of the second generator")
    lines = ["| measure | score | target |", "|---|---|---|"]
    lines += [_line(row, measures[row.measure], found["reliability"]) for row in ROWS]
    source = (
        f"Scored were {len(found['cases'])} cases by {found['version']}: {link(file, 'result')}.\n{_origin(measures)}"
    )
    return "\n".join([*lines, "", source]) + "\n"


def _origin(measures: dict[str, Any]) -> str:
    """Return where the targets come from, those of the second generator beside what the file states."""
    parts = []
    for number, row in enumerate(ROWS, 1):
        if row.low is not None:
            stated = measures[row.measure]["low"]
            of_file = "none" if stated is None else f"that of the first generator, {percent(stated)} %"
            parts.append(f"{percent(row.low)} % in row {number} (the file states {of_file})")
    return (
        "Targets are those of `mccd challenge score` ([measures](challenge.md#the-measures)), except\n"
        f"those of the second generator: {' and '.join(parts)}."
    )


def _line(row: _Row, m: dict[str, Any], bins: Sequence[dict[str, Any]]) -> str:
    low = m["low"] if row.low is None else row.low
    if m["stated"] is not None:
        holds, required = m["ok"], _stated(m["stated"], bins)
    else:
        holds = (low is None or m["value"] >= low) and (m["high"] is None or m["value"] <= m["high"])
        required = _limits(low, m["high"])
    if not m["enough"]:
        required = f"{required} of {m['least']} cases or more"
    ends = "–".join(percent(end) for end in m["interval"])
    score = f"{round(m['value'] * m['n'])} of {m['n']}: {percent(m['value'])} %"
    return f"| {row.words} | {score if holds else f'**{score}**'} ({ends}) | {required} |"


def _limits(low: float | None, high: float | None) -> str:
    if low is not None and high is not None:
        return f"{percent(low)}–{percent(high)} %"
    return f"≥ {percent(low)} %" if low is not None else f"≤ {percent(high or 0.0)} %"


def _stated(mean: float, bins: Sequence[dict[str, Any]]) -> str:
    """Return what was stated of the names, most of them first."""
    parts = [f"{b['n']} at {100.0 * b['stated']:.1f} %" for b in sorted(bins, key=lambda b: -int(b["n"]))]
    return f"the interval contains {100.0 * mean:.1f} %, the mean stated probability ({', '.join(parts)})"
