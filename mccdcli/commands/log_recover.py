"""`mccd log recover`: save what a crash left of a log."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.options import common_options, existing_file
from mccdcli.output import emit
from mccdcli.progress import progress


@click.command()
@existing_file("run")
@common_options("out", "json")
def recover(run: Path, out: Path | None, as_json: bool) -> None:
    """Recover what a crash left of a log into a new file, marked as crashed.

    The new file is RUN.recovered.h5 unless --out names another; the old one is not touched.

    \b
    Examples:
      mccd log recover RUN.h5
      mccd log recover RUN.h5 --out SAVED.h5
    """
    from campaigns.log import recover as recover_log

    with progress("recovering") as report:
        saved = recover_log(run, out or run.with_suffix(f".recovered{run.suffix}"), report)
    text = f"{saved.path}: {saved.rows} of {saved.committed_rows} samples ({saved.reason})"
    emit(saved, as_json=as_json, text=text)
