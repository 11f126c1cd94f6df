"""Plots of the report that answer to a reader. EXPLORERS is the only list: one is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable

from analysis.pages.explorer import Explorer
from analysis.paper.measured import Measured
from analysis.report.explore.bode import bode
from analysis.report.explore.chopping import chopping
from analysis.report.explore.settling import settling_moves

EXPLORERS: tuple[Callable[[Measured], Explorer | None], ...] = (bode, settling_moves, chopping)


def make_explorers(measured: Measured) -> list[Explorer]:
    """Return every explorer for which the campaign holds a run."""
    made = []
    for make in EXPLORERS:
        with measured.tracing() as uids:
            explorer = make(measured)
        if explorer is not None:
            made.append(explorer.resting_on(tuple(sorted(uids))))
    return made
