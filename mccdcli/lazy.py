"""A click group that knows its commands from a table and imports one only when it runs."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module

import click
from click.shell_completion import CompletionItem

from mccdcli.registry import Entry
from mccdcli.settings import Settings, defaults_of, name_variables


class LazyGroup(click.Group):
    """Group whose help, suggestions and completion come from `entries`, and for nested groups from `groups`.

    A name of several words is a path: "log show" is the command `show` in the group `log`.
    """

    def __init__(
        self,
        name: str,
        entries: Mapping[str, Entry],
        groups: Mapping[str, str],
        help: str,
        **settings: object,
    ) -> None:
        super().__init__(name, help=help, **settings)  # type: ignore[arg-type]
        self._entries = entries
        self._groups = groups

    def _helps(self) -> dict[str, str]:
        """One line of help per name at this level, sorted by name."""
        helps = {name: entry.help for name, entry in self._entries.items() if " " not in name}
        nested = {name.partition(" ")[0] for name in self._entries if " " in name}
        return dict(sorted((helps | {name: self._groups[name] for name in nested}).items()))

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names at this level, without importing a command."""
        return list(self._helps())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command or nested group of this name, imported now; None if there is none."""
        if cmd_name in self._entries:
            module, _, attribute = self._entries[cmd_name].target.partition(":")
            command: click.Command = getattr(import_module(module), attribute)
            self._set_defaults(ctx, command, cmd_name)
            if ctx.auto_envvar_prefix:
                name_variables(command, f"{ctx.auto_envvar_prefix}_{cmd_name.replace('-', '_').upper()}")
            return command
        if cmd_name not in self._helps():
            return None
        prefix = f"{cmd_name} "
        below = {n.removeprefix(prefix): entry for n, entry in self._entries.items() if n.startswith(prefix)}
        return LazyGroup(cmd_name, below, {}, help=self._groups[cmd_name])

    def paths(self) -> list[tuple[str, ...]]:
        """Return the words of every command below, in the order of their names."""
        return sorted(tuple(name.split()) for name in self._entries)

    def find(self, words: tuple[str, ...]) -> click.Command | None:
        """Return the command of these words, imported now; None if there is none."""
        found: click.Command | None = self
        for word in words:
            ctx = click.Context(found or self, info_name=word)
            found = found.get_command(ctx, word) if isinstance(found, click.Group) else None
        return found

    def _set_defaults(self, ctx: click.Context, command: click.Command, name: str) -> None:
        """Let the command have the defaults that the user's files give it, under the names of its parameters."""
        settings = ctx.find_object(Settings)
        if settings is not None and not ctx.resilient_parsing:
            above = tuple(ctx.command_path.split()[1:])
            ctx.default_map = {**(ctx.default_map or {}), name: defaults_of(settings, command, (*above, name))}

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does, with suggestions from the table; click looks among imported commands only."""
        try:
            return super().resolve_command(ctx, args)
        except click.exceptions.NoSuchCommand as error:
            raise click.exceptions.NoSuchCommand(error.command_name, possibilities=self._helps(), ctx=ctx) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the table of commands without importing one."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self._helps().items()))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """Complete a name without importing a command."""
        found = [CompletionItem(name, help=help) for name, help in self._helps().items() if name.startswith(incomplete)]
        # click.Group would import every command to ask whether it is hidden; its parent completes the options
        return found + click.Command.shell_complete(self, ctx, incomplete)
