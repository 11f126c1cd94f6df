"""`mccd schema`: the JSON Schema of a command's result."""

from __future__ import annotations

import json

import click

from mccdcli.lazy import LazyGroup
from mccdcli.settings import options_of


@click.command()
@click.argument("command", nargs=-1, metavar="COMMAND", required=True)
@click.pass_context
def schema(ctx: click.Context, command: tuple[str, ...]) -> None:
    """Print the JSON Schema of what COMMAND prints with --json, every value described.

    \b
    Examples:
      mccd schema chop
      mccd schema log show > log-show.schema.json
    """
    from mccdcli.schema import schema_of

    tree, name = ctx.find_root().command, " ".join(command)
    assert isinstance(tree, LazyGroup)
    found = tree.find(command)
    dry = found is not None and any(option == "dry-run" for option, _ in options_of(found))
    click.echo(json.dumps(schema_of(name, dry_run=dry), indent=2, ensure_ascii=False))
