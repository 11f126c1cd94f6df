"""`mccd log export`: a log for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import NewPath, common_options, existing_file
from mccdcli.output import emit
from mccdcli.progress import progress


@click.command()
@existing_file("run", metavar="RUN.h5")
@click.option(
    "-o",
    "--out",
    required=True,
    type=NewPath(dir_okay=False),
    metavar="FILE",
    help="File to write; its ending selects the format: .csv, .mat, .npz or .nxs.",
)
@common_options("json")
def export(run: Path, out: Path, as_json: bool) -> None:
    """Export a log for other programs, with units, times and segments where the format can hold them.

    The log itself is plain HDF5, which most programs read; docs/log-format.md shows how.

    \b
    Examples:
      mccd log export RUN.h5 -o run.mat
      mccd log export RUN.h5 -o run.nxs
      mccd log export RUN.h5 -o run.csv
    """
    from campaigns.log import read_run
    from campaigns.log.export import save

    with read_run(run) as log, progress("exporting") as report:
        save(log, out, report)
        rows, channels = log.rows, list(log.channels)
    result = {"file": out, "run_uid": log.run_uid, "rows": rows, "channels": channels}
    emit(result, as_json=as_json, text=f"{out}: {rows} samples of {len(channels)} channels")
