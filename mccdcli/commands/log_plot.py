"""`mccd log plot`: the channels of a log over time."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import common_options, existing_file
from mccdcli.output import emit, table


@click.command()
@existing_file("run")
@common_options("out", "json")
def plot(run: Path, out: Path | None, as_json: bool) -> None:
    """Draw every channel of a log over time: a picture with --out (.png, .svg, .pdf), else in the terminal.

    \b
    Examples:
      mccd log plot RUN.h5
      mccd log plot RUN.h5 --out RUN.png
    """
    from campaigns.log import read_run
    from campaigns.log.plot import drawn, save_picture

    with read_run(run) as log:
        rows = drawn(log) if out is None else []
        if out is not None:
            save_picture(log, out)
    result = {"file": run, "picture": out, "channels": [{"name": n, "drawn": d, "range": r} for n, d, r in rows]}
    emit(result, as_json=as_json, text=table(rows) if out is None else str(out))
