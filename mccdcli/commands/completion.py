"""`mccd completion`: the shell's completion script."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class


@click.command()
@click.argument("shell", metavar="bash|zsh|fish", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def completion(ctx: click.Context, shell: str) -> None:
    """Print the script that completes mccd in your shell.

    \b
    Examples:
      mccd completion bash > ~/.local/share/bash-completion/completions/mccd
      eval "$(mccd completion zsh)"
    """
    script = get_completion_class(shell)
    assert script is not None, "click knows each shell that the argument admits"
    click.echo(script(ctx.find_root().command, {}, "mccd", "_MCCD_COMPLETE").source())
