"""`mccd config show`: what every option is set to, and by what."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Mapping
from typing import Any, Final

import click
from click.core import ParameterSource

from mccdcli.lazy import LazyGroup
from mccdcli.options import common_options
from mccdcli.output import emit, plain, table
from mccdcli.settings import FOR_ALL, PREFIX, Settings, options_of, places, same
from sim_backend.errors import ConfigError

_NONE: Final = "none"

_WORKED_OUT: Final = re.compile(r"\[default: (.+)\]$")
"""How the help of an option ends whose default only the command itself can work out."""


@click.command(context_settings={"ignore_unknown_options": True, "allow_interspersed_args": False})
@click.argument("command", nargs=-1, type=click.UNPROCESSED, metavar="[COMMAND [OPTION]…]")
@common_options("json")
@click.pass_context
def show(ctx: click.Context, command: tuple[str, ...], as_json: bool) -> None:
    """Show what every option of COMMAND is set to and by what: default, file, environment or option.

    Two files are read: ~/.config/mccd/config.toml, then mccd.toml in the current folder, which overrules the first;
    MCCD_CONFIG names a file that replaces both. A table has a command's name and holds its options; [defaults] holds
    bench and seed for all. A variable is named MCCD_COMMAND_OPTION after the option's long name. An option overrules a
    variable, a variable a file, and a file the default. Without COMMAND, everything that differs from its default is
    shown.

    \b
    Examples:
      mccd config show chop --cycles 3
      MCCD_SEED=7 mccd config show
      mccd config show --json campaign run
    """
    tree, settings = ctx.find_root().command, ctx.find_object(Settings) or Settings()
    assert isinstance(tree, LazyGroup)
    wanted = command or None
    found: dict[str, dict[str, Any]] = {}
    typed: dict[tuple[str, str], str] = {}
    for name in tree.paths() if wanted is None else [_path(tree, wanted)]:
        arguments = [] if wanted is None else list(wanted[len(name) :])
        rows = _parameters(ctx, tree, name, arguments, settings)
        typed |= {(" ".join(name), key): row.pop("typed") for key, row in rows.items()}
        kept = {k: v for k, v in rows.items() if wanted is not None or v["origin"] != "default"}
        if kept:
            found[" ".join(name)] = kept
    files = [{"path": path, "found": path.is_file()} for path in places()]
    variables = {k: v for k, v in sorted(os.environ.items()) if k.startswith(f"{PREFIX}_")}
    result = {"files": files, "environment": variables, "commands": found}
    emit(result, as_json=as_json, text=_text(result, typed))


def _path(tree: LazyGroup, words: tuple[str, ...]) -> tuple[str, ...]:
    paths = tree.paths()
    for length in (2, 1):
        if words[:length] in paths:
            return words[:length]
    given = " ".join(words)
    raise ConfigError(f"there is no command '{given}'; `mccd --help` lists them")


def _parameters(
    ctx: click.Context, tree: LazyGroup, path: tuple[str, ...], arguments: list[str], settings: Settings
) -> dict[str, Any]:
    parent = ctx.find_root()
    group: click.Command = tree
    for word in path[:-1]:
        assert isinstance(group, click.Group)
        group = group.get_command(parent, word) or group
        parent = click.Context(group, parent=parent, info_name=word)
    assert isinstance(group, click.Group)
    leaf = group.get_command(parent, path[-1])
    assert leaf is not None
    # resilient: what the command needs besides its options (a file, say) may be left out here
    with leaf.make_context(path[-1], list(arguments), parent=parent, resilient_parsing=True) as inner:
        given, _, _ = leaf.make_parser(inner).parse_args(list(arguments))
        return {
            name: _described(inner, option, name, given, path, settings)
            for name, option in options_of(leaf)
            if option.name != "help"
        }


def _described(
    inner: click.Context,
    option: click.Option,
    name: str,
    given: Mapping[str, Any],
    path: tuple[str, ...],
    settings: Settings,
) -> dict[str, Any]:
    """Return the row of an option; `given` are the texts of the command line by parameter."""
    assert option.name is not None
    text, source = option.consume_value(inner, given)
    assert isinstance(option.envvar, str)
    origin, where = "default", ""
    if source is ParameterSource.COMMANDLINE:
        origin, where = "option", option.opts[0]
    elif source is ParameterSource.ENVIRONMENT:
        read = (option.envvar, f"{inner.auto_envvar_prefix}_{option.name.upper()}")
        origin, where = "environment", next(variable for variable in read if os.environ.get(variable))
    elif source is ParameterSource.DEFAULT_MAP:
        keys = (key for key in settings.origins if key[:-1] in (path, (FOR_ALL,)) and same(key[-1], name))
        origin, where = "file", str(settings.origins[max(keys, key=lambda key: key[:-1] == path)])
    value = inner.params.get(option.name)
    typed = _typed(option, text if origin != "default" or value is not None else None, value)
    said = _WORKED_OUT.search(option.help or "") if origin == "default" and typed == _NONE else None
    return {
        "value": plain(value if option.expose_value or origin == "default" else text),
        "typed": said[1] if said else typed,
        "origin": origin,
        "where": where,
        "variable": option.envvar,
    }


def _typed(option: click.Option, text: Any, value: Any) -> str:
    """Return what one types for an option, in the settings files true or false for a flag; `text` is what was typed.

    A text that the command would refuse is shown all the same: it may be what is looked for.
    """
    if isinstance(value, bool):
        return str(value).lower()
    words = [shlex.quote(str(one)) for one in (text if isinstance(text, list | tuple) else [text])]
    return f" {option.opts[0]} ".join(words) if text not in (None, "") and value not in ((), {}) else _NONE


def _text(result: dict[str, Any], typed: dict[tuple[str, str], str]) -> str:
    """Return the tables; `typed` are the values as one types them, by command and option."""
    files = [(str(file["path"]), "read" if file["found"] else "not there") for file in result["files"]]
    parts = [table(files, heads=("file", ""))]
    for name, options in result["commands"].items():
        rows = [
            (f"--{key}", typed[name, key], " ".join((one["origin"], one["where"])).rstrip(), one["variable"])
            for key, one in options.items()
        ]
        parts.append(table(rows, heads=(name, "value", "from", "variable")))
    if not result["commands"]:
        parts.append("every option of every command has its default")
    return "\n\n".join(parts)
