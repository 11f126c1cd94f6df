"""`mccd log summary`: each channel in a few numbers."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import common_options, existing_file
from mccdcli.output import emit, table
from mccdcli.progress import progress


@click.command()
@existing_file("run")
@common_options("json")
def summary(run: Path, as_json: bool) -> None:
    """Summarise every channel of a log: smallest and largest value, mean and standard deviation.

    \b
    Examples:
      mccd log summary RUN.h5
      mccd log summary RUN.h5 --json
    """
    from analysis.pages.formats import readable
    from campaigns.log import read_run
    from campaigns.log.summary import summarise

    with read_run(run) as log, progress("summarising") as report:
        found = summarise(log, report=report)
        result = {"file": run, "run_uid": log.run_uid, "rows": log.rows, "channels": list(found)}
    rows = [(c.name, c.unit, *(readable(v, 6) for v in (c.smallest, c.largest, c.mean, c.std))) for c in found]
    emit(result, as_json=as_json, text=table(rows, heads=("channel", "unit", "smallest", "largest", "mean", "std")))
