"""`mccd watch`: a run while it is recorded."""

from __future__ import annotations

import json
import math
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from mccdcli.options import RealRange, common_options
from mccdcli.output import emit, plain, say, table, visible
from mccdcli.trials import quantity

if TYPE_CHECKING:
    from analysis.recorded.watching import Snapshot

BARS: Final = "▁▂▃▄▅▆▇█"
PATIENCE: Final = 5
"""How many looks in a row may fail: one may fall into the moment at which the writer flushes."""


@click.command()
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN.h5")
@click.option("--model", metavar="MODEL", help="Also simulate this model's linear part and show the residual.")
@click.option(
    "--every",
    "period_s",
    type=RealRange(0.05, 3600.0),
    default=0.5,
    show_default=True,
    metavar="S",
    help="Seconds between two looks.",
)
@click.option("--wait", is_flag=True, help="Wait for the log to appear.")
@click.option("--once", is_flag=True, help="Look once and stop.")
@common_options("json")
def watch(run: Path, as_json: bool, model: str | None, period_s: float, wait: bool, once: bool) -> int:
    """Watch a run while it is recorded: angles, residual against a model, status, time left.

    Ends when the run does; the exit code is 1 when that failed, crashed or was aborted. The writer is never disturbed.
    With --json, one JSON object per line and look.

    \b
    Examples:
      mccd watch chop.h5 --model design
      mccd watch runs/sweep-x.h5 --wait
      mccd watch chop.h5 --once --json
    """
    from campaigns.log.probe import prepare

    prepare()
    while wait and not run.exists():
        time.sleep(period_s)
    last: Snapshot | None = None
    live = sys.stdout.isatty() and os.environ.get("TERM") != "dumb" and not as_json and not once
    looks = _looks(run, model, period_s, once)
    if live:
        last = _live(looks)
    else:
        for last in looks:
            if once:
                emit(last, as_json=as_json, text=_text(last))
            elif as_json:
                click.echo(json.dumps(plain(last), allow_nan=False))
            else:
                click.echo(visible(_line(last)))
    return 1 if last is not None and last.status in ("failed", "crashed", "aborted") else 0


def _looks(run: Path, model: str | None, period_s: float, once: bool) -> Iterator[Snapshot]:
    """Yield the run as it is every `period_s` until it ends."""
    from analysis.recorded.watching import Watch
    from sim_backend.errors import DataError
    from sim_backend.model import load_model

    watching = Watch(run, None if model is None else load_model(model))
    failures = 0
    while True:
        try:
            found = watching.look(time.monotonic())
        except DataError:
            failures += 1
            if failures > PATIENCE or not run.exists():
                raise
            time.sleep(0.05)
            continue
        failures = 0
        yield found
        if once or not found.running:
            return
        time.sleep(period_s)


def _live(looks: Iterator[Snapshot]) -> Snapshot | None:
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    last = None
    with Live(Text(""), console=Console(), auto_refresh=False) as screen:
        for last in looks:
            screen.update(Text(visible(_text(last))), refresh=True)
    if last is not None:
        say(f"mccd: the run is {last.status}")
    return last


def _text(one: Snapshot) -> str:
    done = "" if not one.expected_rows else f" of {one.expected_rows} rows ({one.rows / one.expected_rows:.0%})"
    parts = [
        table(
            [
                ("run", f"{one.test} {one.run_uid[:8]}"),
                ("status", one.status + (f" ({one.status_reason})" if one.status_reason else "")),
                ("segment", one.segment or "none yet"),
                ("recorded", f"{one.recorded_s:.1f} s, {one.rows}{done or ' rows'}"),
                ("time left", _left(one)),
            ]
        )
    ]
    if one.readings:
        rows = [
            (r.name, quantity(r.last, r.unit), quantity(r.low, r.unit), quantity(r.high, r.unit), _bars(list(r.recent)))
            for r in one.readings
        ]
        parts.append(table(rows, heads=("output", "now", "lowest", "highest", "last seconds")))
    if one.misfits:
        off = [
            (
                m.dof,
                quantity(m.residual_rms, m.unit),
                quantity(m.output_rms, m.unit),
                _share(m.residual_rms, m.output_rms),
            )
            for m in one.misfits
        ]
        parts.append(table(off, heads=("residual", "rms", "output rms", "share")))
    return "\n\n".join(parts)


def _line(one: Snapshot) -> str:
    now = ", ".join(f"{r.name} {quantity(r.last, r.unit)}" for r in one.readings)
    off = ", ".join(f"{m.dof} off by {quantity(m.residual_rms, m.unit)} rms" for m in one.misfits)
    parts = [one.status, f"{one.recorded_s:.1f} s recorded", f"{_left(one)} left" if one.running else "", now, off]
    return "; ".join(part for part in parts if part)


def _left(one: Snapshot) -> str:
    if one.left_s is None:
        return "unknown"
    minutes, seconds = divmod(round(one.left_s), 60)
    return f"{minutes} min {seconds} s" if minutes else f"{seconds} s"


def _share(part: float, whole: float) -> str:
    return f"{part / whole:.1%}" if whole > 0.0 and math.isfinite(part) else "—"


def _bars(values: list[float]) -> str:
    """Return one bar per value, a gap for what is no number."""
    there = [v for v in values if math.isfinite(v)]
    low, span = min(there, default=0.0), max(there, default=0.0) - min(there, default=0.0)

    def bar(value: float) -> str:
        if not math.isfinite(value):
            return " "
        return BARS[min(int((value - low) / span * len(BARS)), len(BARS) - 1)] if span > 0.0 else BARS[0]

    return "".join(map(bar, values))
