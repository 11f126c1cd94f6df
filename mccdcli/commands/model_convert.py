"""`mccd model convert`: a model in another format."""

from __future__ import annotations

from pathlib import Path

import click

from mccdcli.models import refuse_existing
from mccdcli.options import NewPath, common_options
from mccdcli.output import emit


@click.command()
@click.argument("model", metavar="MODEL")
@click.option(
    "-o",
    "--out",
    required=True,
    type=NewPath(dir_okay=False),
    metavar="FILE",
    help="File to write; its ending selects the format: .toml or .json.",
)
@click.option("--force", is_flag=True, help="Replace an existing file.")
@common_options("json")
def convert(model: str, out: Path, force: bool, as_json: bool) -> None:
    """Convert a model between TOML and JSON, checked on the way.

    MODEL is a bundled one or a file. Every command that takes a model reads either format.

    \b
    Examples:
      mccd model convert design -o design.json
      mccd model convert extended.json -o extended.toml
    """
    from sim_backend.errors import ConfigError

    form = out.suffix.lower().removeprefix(".")
    if form not in ("toml", "json"):
        raise ConfigError(f"{out}: '{out.suffix}' is not a format of models; use .toml or .json")
    refuse_existing(out, force=force)

    from sim_backend.model import dump_model, load_model
    from sim_backend.safe_write import write_text

    found = load_model(model)
    write_text(out, dump_model(found, "json" if form == "json" else "toml"))
    emit({"file": out, "name": found.name}, as_json=as_json, text=f"{found.name}: {out}")
