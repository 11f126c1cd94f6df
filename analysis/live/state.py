"""What the page shows of a run at one moment: its state in words, and the newest seconds of its outputs as plots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np

from analysis.pages.canvas import Array, thinned
from analysis.pages.explorer import Explorer, Facts, Panel, Series, View
from analysis.pages.formats import unit_text
from analysis.pages.quantities import scaled, time_left
from analysis.recorded.watching import Misfit, Reading, Snapshot, Watch
from campaigns.log import Run, read_run
from sim_backend.axis_names import axis_text
from sim_backend.readings import with_gaps

MOST_PLOTS: Final = 8
"""How many outputs have a plot; the table has all."""

POINTS: Final = 800
"""Longest curve that is sent, some times a second."""


@dataclass(frozen=True)
class State:
    """What the page shows: `texts` by the name of their element, `trouble` when the log could not be read."""

    title: str
    texts: Mapping[str, str]
    explorer: Explorer
    trouble: str = ""

    def with_trouble(self, what: str) -> Self:
        """Return the same with what kept the newest look from succeeding."""
        return replace(self, trouble=what)

    def as_json(self) -> dict[str, Any]:
        """Return the state as the page's script reads it."""
        return {"texts": {**self.texts, "trouble": self.trouble}, "explorer": self.explorer.as_json()}


def look(watching: Watch, now_s: float) -> tuple[Snapshot, State]:
    """Look at the run: what is known of it, and what the page shows of it; raises as `Watch.look`."""
    with read_run(watching.path) as run:
        seen = watching.seen(run, now_s)
        return seen, State(watching.path.name, _texts(seen), _explorer(watching, run, seen))


def _texts(seen: Snapshot) -> dict[str, str]:
    return {
        "test": seen.test,
        "run": seen.run_uid[:8],
        "note": seen.note,
        "status": seen.status,
        "reason": seen.status_reason,
        "segment": seen.segment or ("none yet" if seen.running else "none"),
        "recorded": f"{seen.recorded_s:.1f} s",
        "rows": seen.samples,
        "left": time_left(seen.left_s),
    }


def _explorer(watching: Watch, run: Run, seen: Snapshot) -> Explorer:
    start = watching.first_row(run)
    shown = run.names("output")[:MOST_PLOTS] if run.rows > start else ()
    panels = tuple(_panel(watching, run, name, start) for name in shown)
    more = len(seen.readings) - len(panels)
    note = f"{more} more outputs are in the table alone." if more else ""
    if watching.model is not None:
        note = f"Simulated: the linear part of the model, from rest at the start of the run. {note}".strip()
    view = View(panels, _facts(seen), note if panels else "No sample is recorded yet.")
    remark = (
        f"The last {watching.window_s:g} s of every output; long curves show the smallest and the largest reading of "
        "every stretch. A gap: the bench gave no number."
    )
    return Explorer("live", "Outputs", remark, {}, {(): view})


def _panel(watching: Watch, run: Run, name: str, start: int) -> Panel:
    channel, measured = run.channels[name], with_gaps(run.stored(name, start))
    time_s = (np.arange(measured.size) - (measured.size - 1)) / channel.sample_rate_hz
    there = np.abs(measured[np.isfinite(measured)])
    factor, unit = scaled(float(there.max(initial=0.0)), channel.unit)
    series = [_series("measured", time_s, measured * factor)]
    simulated = watching.simulated(name, measured.size)
    if simulated is not None:
        series.append(_series("simulated", time_s, simulated * factor))
    return Panel("time before the newest sample (s)", _with_unit(name, unit), tuple(series))


def _series(name: str, x: Array, y: Array) -> Series:
    return Series(name, *thinned(x, y, POINTS))


def _facts(seen: Snapshot) -> Facts:
    misfits = {one.dof: one for one in seen.misfits}
    heads: tuple[str, ...] = ("output", "now", "lowest", "highest")
    if misfits:
        heads += ("residual rms", "output rms")
    return Facts(heads, tuple(_row(one, misfits.get(one.dof), bool(misfits)) for one in seen.readings))


def _row(one: Reading, misfit: Misfit | None, simulated: bool) -> tuple[str, tuple[float | None, ...]]:
    largest = np.nanmax(np.abs([one.low, one.high])) if np.isfinite(one.low) else 0.0
    factor, unit = scaled(float(largest), one.unit)
    values: tuple[float | None, ...] = (one.last * factor, one.low * factor, one.high * factor)
    if simulated:
        both = (None, None) if misfit is None else (misfit.residual_rms * factor, misfit.output_rms * factor)
        values += both
    return _with_unit(one.name, unit), values


def _with_unit(name: str, unit: str) -> str:
    shown = unit_text(unit)
    return f"{axis_text(name)} ({shown})" if shown else axis_text(name)
