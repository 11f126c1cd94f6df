"""`mccd import`: data of another bench into a log."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.logtext import channels_text, length_text, segments_text
from mccdcli.options import common_options, existing_file
from mccdcli.output import emit
from mccdcli.progress import progress


@click.command("import")
@existing_file("map", metavar="MAP.toml")
@common_options("out", "json")
def import_data(map: Path, out: Path | None, as_json: bool) -> None:
    """Import data of any bench into a log, as a map file describes them.

    The log is MAP.h5 in the current folder unless --out names another; an existing file is never overwritten.

    \b
    Examples:
      mccd import MAP.toml
      mccd import MAP.toml --out RUN.h5 --json
    """
    from campaigns.importing import import_run

    with progress("importing") as report:
        made = import_run(map, out or Path(f"{map.stem}.h5"), report)
    summary = f"{made.path}: {length_text(made.rows, made.sample_rate_hz)}"
    clock = [f"clock: {made.clock}"] if made.clock else []
    remarks = [f"remark: {remark}" for remark in made.remarks]
    text = "\n\n".join(
        ["\n".join([summary, *clock, *remarks]), channels_text(made.channels), segments_text(made.segments)]
    )
    emit(made, as_json=as_json, text=text)
