"""`mccd import`: data of another bench into a log."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.idle_options import refuse_typed
from mccdcli.logtext import channels_text, length_text, segments_text
from mccdcli.options import common_options, given_note
from mccdcli.output import emit, say
from mccdcli.progress import progress


@click.command("import")
@click.argument(
    "files", nargs=-1, required=True, metavar="MAP.toml", type=click.Path(exists=True, dir_okay=False, path_type=Path)
)
@click.option("--guess", is_flag=True, help="Propose a map for data files instead: printed, or written with --out.")
@click.option("--allow-outside", is_flag=True, help="Let the map read files outside its own folder.")
@common_options("out", "note", "json")
def import_data(files: tuple[Path, ...], guess: bool, allow_outside: bool, out: Path | None, as_json: bool) -> None:
    """Import data of any bench into a log, as a map file describes them.

    The log is MAP.h5 in the current folder unless --out names another; an existing file is never overwritten.
    With --guess the files are data, and a commented map is proposed for them. A map reads files of its own folder and
    below; --allow-outside is for maps that you trust.

    \b
    Examples:
      mccd import --guess data.csv -o map.toml
      mccd import MAP.toml
      mccd import MAP.toml --out RUN.h5 --json
    """
    if guess:
        refuse_typed(
            ("allow_outside", "note"), "goes with a map, and --guess only proposes one; leave out one of the two"
        )
        _guess(files, out, as_json)
        return
    if len(files) != 1:
        raise click.UsageError("give one map, or --guess with data files")
    (map,) = files
    from campaigns.importing import import_run

    with progress("importing") as report:
        made = import_run(map, out or Path(f"{map.stem}.h5"), report, allow_outside=allow_outside, note=given_note())
    summary = f"{made.path}: {length_text(made.rows, made.sample_rate_hz)}"
    clock = [f"clock: {made.clock}"] if made.clock else []
    remarks = [f"remark: {remark}" for remark in made.remarks]
    head = "\n".join([summary, *clock, *remarks])
    text = "\n\n".join([head, channels_text(made.channels), segments_text(made.segments)])
    emit(made, as_json=as_json, text=text)


def _guess(files: tuple[Path, ...], out: Path | None, as_json: bool) -> None:
    from campaigns.importing.guess import guess
    from sim_backend.errors import ConfigError
    from sim_backend.safe_write import write_text

    if out is not None and out.exists():
        raise ConfigError(f"{out} exists and is not overwritten: choose another path with --out")
    # sources of a map count from its folder
    folder = (out.parent if out else Path()).resolve()
    found = guess(files, folder)
    for line in found.said:
        say(f"guess: {line}")
    if out is not None:
        write_text(out, found.text)
    result = {"map": out, "text": found.text, "said": list(found.said)}
    outside = "" if all(path.resolve().is_relative_to(folder) for path in files) else " --allow-outside"
    emit(
        result,
        as_json=as_json,
        text=found.text.rstrip() if out is None else f"{out}: look at it, then `mccd import {out}{outside}`",
    )
