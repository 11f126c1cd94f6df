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

from mccdcli.idle_options import refuse_typed
from mccdcli.options import RealRange, WholeRange, common_options
from mccdcli.output import emit, plain, say, table, visible
from mccdcli.trials import quantity

if TYPE_CHECKING:
    from analysis.recorded.watching import Snapshot

BARS: Final = "▁▂▃▄▅▆▇█"


@click.command()
@click.argument("run", type=click.Path(path_type=Path), metavar="RUN.h5")
@click.option("--model", metavar="MODEL", help="Model whose linear part is simulated to show the residual.")
@click.option(
    "--every",
    "period_s",
    type=RealRange(0.05, 3600.0),
    default=0.5,
    show_default=True,
    metavar="S",
    help="Seconds between two updates.",
)
@click.option("--wait", is_flag=True, help="Wait for the log to appear.")
@click.option("--once", is_flag=True, help="Show the run once and stop.")
@click.option("--web", is_flag=True, help="Show live plots in the browser, on this machine alone, until Ctrl-C.")
@click.option("--port", type=WholeRange(0, 65535), metavar="N", help="Port of --web.  [default: a free one]")
@common_options("json")
def watch(
    run: Path, as_json: bool, model: str | None, period_s: float, wait: bool, once: bool, web: bool, port: int | None
) -> int:
    """Watch a run while it is recorded: angles, residual against a model, status, time left.

    Ends with the run; the exit code is 1 when the run failed, crashed or was aborted. The recording is never disturbed.
    With --json every update is one line, a JSON object.

    With --web the address of a read-only page is printed first; its plots and numbers follow the run. All users of this
    machine can open it. It stays when the run has ended; if another run takes its place, the page follows that.

    \b
    Examples:
      mccd watch chop.h5 --model design
      mccd watch runs/sweep-x.h5 --wait
      mccd watch chop.h5 --once --json
      mccd watch runs/sweep-x.h5 --wait --web --port 8080
    """
    if web and (as_json or once):
        raise click.UsageError("--web shows the run in the browser until Ctrl-C; leave out --json and --once")
    if port is not None and not web:
        raise click.UsageError("--port is that of the page: add --web, or leave it out")
    if once and not wait:
        refuse_typed(("period_s",), "has no effect: --once looks once; leave out one of the two")
    from campaigns.log.probe import prepare

    prepare()
    while wait and not run.exists():
        time.sleep(period_s)
    if web:
        return _exit_code(_in_browser(run, model, period_s, port or 0))
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
    return _exit_code(last)


def _exit_code(last: Snapshot | None) -> int:
    return 1 if last is not None and last.status in ("failed", "crashed", "aborted") else 0


def _in_browser(run: Path, model: str | None, period_s: float, port: int) -> Snapshot:
    from analysis.live.serve import show
    from analysis.recorded.watching import Watch
    from sim_backend.model import load_model

    watching = Watch(run, None if model is None else load_model(model))
    return show(
        watching, period_s, port, lambda address: click.echo(f"{address} shows {visible(str(run))}; Ctrl-C ends it")
    )


def _looks(run: Path, model: str | None, period_s: float, once: bool) -> Iterator[Snapshot]:
    """Yield the run as it is every `period_s` until it ends."""
    from analysis.recorded.ctrl_c import awaited
    from analysis.recorded.watching import Watch, patiently
    from sim_backend.model import load_model

    watching = Watch(run, None if model is None else load_model(model))
    with awaited() as ctrl_c_within:
        while True:
            found = patiently(lambda: watching.look(time.monotonic()), run)
            yield found
            if once or not found.running:
                return
            if ctrl_c_within(period_s):
                raise KeyboardInterrupt


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
    from analysis.pages.quantities import time_left

    parts = [
        table(
            [
                ("run", f"{one.test} {one.run_uid[:8]}"),
                ("status", one.status + (f" ({one.status_reason})" if one.status_reason else "")),
                ("segment", one.segment or "none yet"),
                ("recorded", f"{one.recorded_s:.1f} s, {one.samples}"),
                *([("note", one.note)] if one.note else []),
                *([] if one.left_s is None else [("time left", time_left(one.left_s))]),
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
    from analysis.pages.quantities import time_left

    now = ", ".join(f"{r.name} {quantity(r.last, r.unit)}" for r in one.readings)
    off = ", ".join(f"{m.dof} off by {quantity(m.residual_rms, m.unit)} rms" for m in one.misfits)
    parts = [
        one.status,
        f"{one.recorded_s:.1f} s recorded",
        f"{time_left(one.left_s)} left" if one.running and one.left_s is not None else "",
        now,
        off,
    ]
    return "; ".join(part for part in parts if part)


def _share(part: float, whole: float) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole > 0.0 and math.isfinite(part) else "—"


def _bars(values: list[float]) -> str:
    """Return one bar per value, a gap for what is not a number."""
    there = [v for v in values if math.isfinite(v)]
    low, span = min(there, default=0.0), max(there, default=0.0) - min(there, default=0.0)

    def bar(value: float) -> str:
        if not math.isfinite(value):
            return " "
        return BARS[min(int((value - low) / span * len(BARS)), len(BARS) - 1)] if span > 0.0 else BARS[0]

    return "".join(map(bar, values))
