"""Tables of docs/ that are made from files in benchmarks/results/, one maker each."""

from __future__ import annotations

from benchmarks.pages import robustness, scores
from benchmarks.pages.marks import DOCS, Table
from benchmarks.speed import page as speed

TABLES = (
    Table("speed", DOCS / "speed.md", speed.table),
    Table("scores", DOCS / "diagnosis-limits.md", scores.table),
    Table("robustness", DOCS / "control.md", robustness.table),
)
"""Every made table, by the name in its marks."""
