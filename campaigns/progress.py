"""How long work tells how far it is: a callable, handed in by whoever wants to know."""

from __future__ import annotations

from collections.abc import Callable

Report = Callable[[float, float, str], None]
"""report(done, total, what): how much of the work is done, in any unit, and what is being done now."""


def unheard(done: float, total: float, what: str) -> None:
    """Say nothing."""


def part_of(report: Report, start: float, stop: float) -> Report:
    """Return the report of a part of the work, from `start` to `stop` as shares of all of it."""

    def told(done: float, total: float, what: str) -> None:
        report(start + (stop - start) * (done / total if total > 0.0 else 0.0), 1.0, what)

    return told
