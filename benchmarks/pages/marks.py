"""Where a page holds a made table: between `<!-- BEGIN NAME: FILE … -->` and `<!-- END NAME -->`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_UP, Decimal
from pathlib import Path

ROOT = Path(__file__).parents[2]
DOCS, RESULTS = ROOT / "docs", ROOT / "benchmarks" / "results"

NOTHING = 1e-9
"""A share below is zero but for rounding."""


@dataclass(frozen=True)
class Table:
    """A table of a page: its name in the marks, the page, and what makes its Markdown from results files."""

    name: str
    page: Path
    make: Callable[[Sequence[Path]], str]

    @property
    def begin(self) -> str:
        """The first mark up to the names of the files."""
        return f"<!-- BEGIN {self.name}:"

    @property
    def end(self) -> str:
        """The last mark."""
        return f"<!-- END {self.name} -->"


def with_table(page: str, table: Table, files: Sequence[Path]) -> str:
    """Return the page with the table of these results between its marks; raises ValueError where it lacks one."""
    before, begin, rest = page.partition(table.begin)
    _, end, after = rest.partition(table.end)
    if not begin or not end:
        raise ValueError(f"the page lacks '{table.begin} …' or '{table.end}'; put both where the table belongs")
    named = " ".join(file.name for file in files)
    return f"{before}{table.begin} {named} -->\n\n{table.make(files)}\n{table.end}{after}"


def files_of(page: str, table: Table) -> list[Path]:
    """Return the results that the page's table is made from, in its order; none where the page has no mark."""
    named = page.partition(table.begin)[2].partition("-->")[0]
    return [RESULTS / name for name in named.split()]


def link(file: Path, text: str) -> str:
    """Return a link from a page of docs/ to a results file."""
    return f"[{text}](../benchmarks/results/{file.name})"


def percent(share: float) -> str:
    """Return a share in whole percent, halves rounded up; below 1 % and above 99 % to one decimal."""
    whole = 0.01 <= share <= 0.99 or share < NOTHING or share == 1.0
    value = Decimal(f"{100.0 * share:.6f}")
    return f"{value.quantize(Decimal('1' if whole else '0.1'), ROUND_HALF_UP)}"
