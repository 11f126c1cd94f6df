"""Options that have no effect beside others: refused where they are typed, so that nobody waits for what they ask."""

from __future__ import annotations

from collections.abc import Collection

import click
from click.core import ParameterSource

from mccdcli.settings import options_of


def refuse_typed(names: Collection[str], why: str) -> None:
    """Raise UsageError for an option of the running command that is on its command line; `names` are as in Python.

    `why` completes the sentence that begins with the option. Variables and settings files hold for other calls too:
    what they set is not refused.
    """
    context = click.get_current_context()
    for long, option in options_of(context.command):
        name = option.name or ""
        if name in names and context.get_parameter_source(name) is ParameterSource.COMMANDLINE:
            raise click.UsageError(f"--{long} {why}")
