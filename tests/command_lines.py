"""Command lines as they stand in texts: taken apart, and held to the commands that there are."""

from __future__ import annotations

import re
import shlex

import click

from mccdcli.main import cli


def calls_in(line: str) -> list[list[str]]:
    """Return the words of each call of mccd in a line of shell, without what the shell keeps to itself."""
    line = line.removeprefix('eval "$(').removesuffix(')"')
    pieces = re.split(r"\||&&|;", re.sub(r"(?<=\s)[<>] *\S+| &$", "", line))
    words = [shlex.split(piece, comments=True) for piece in pieces]
    without_variables = [w[next((i for i, one in enumerate(w) if "=" not in one), 0) :] for w in words]
    return [w for w in without_variables if w and w[0] == "mccd"]


def check(words: list[str]) -> None:
    """Raise click's usage error unless the words are a command with options that it has; values are not looked at."""
    command: click.Command = cli
    ctx, rest = click.Context(cli, info_name="mccd"), words[1:]
    while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
        _, found, rest = command.resolve_command(ctx, rest)
        assert found is not None
        command = found
        ctx = click.Context(command, info_name=command.name, parent=ctx, **command.context_settings)
    command.make_parser(ctx).parse_args(list(rest))
