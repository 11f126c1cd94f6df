"""The table at the head of docs/speed.md, made from results files: what the page says is what they hold."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.speed.report import limit_of, measured_of


def table(files: Sequence[Path]) -> str:
    """Return a row for every target of these results, as Markdown; a target of two files is told from the first.

    Raises ValueError for results of small sizes, which say nothing of speed.
    """
    lines = ["| work | target | measured |", "|---|---|---|"]
    told: set[tuple[str, str]] = set()
    for file in files:
        found = json.loads(file.read_text(encoding="utf-8"))
        if found["quick"]:
            raise ValueError(
                f"{file.name} was measured with small sizes, which say nothing of speed; run without --quick"
            )
        for row in found["benchmarks"]:
            for target in row["targets"]:
                if target["reached"] is not None and (row["name"], target["what"]) not in told:
                    told.add((row["name"], target["what"]))
                    lines.append(_line(row["name"], target, file.name))
    return "\n".join(lines) + "\n"


def _line(name: str, target: dict[str, Any], file: str) -> str:
    verdict = "" if target["reached"] else ", **missed**"
    measured = f"[{measured_of(target)}](../benchmarks/results/{file})"
    return f"| {name}: {target['what']} | {limit_of(target)} | {measured}{verdict} |"
