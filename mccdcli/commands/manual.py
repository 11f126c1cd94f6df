"""`mccd manual`: the manual of all commands."""

from __future__ import annotations

import click

from mccdcli.lazy import LazyGroup


@click.command()
@click.option(
    "--format",
    "form",
    type=click.Choice(["man", "markdown"]),
    default="man",
    show_default=True,
    help="As a page for man, or for the documents.",
)
@click.pass_context
def manual(ctx: click.Context, form: str) -> None:
    """Print the manual: every command with its options and examples.

    \b
    Examples:
      mccd manual > ~/.local/share/man/man1/mccd.1
      mccd manual --format markdown
    """
    from campaigns.version import tool_version
    from mccdcli.manual import man_page, markdown

    tree = ctx.find_root().command
    assert isinstance(tree, LazyGroup)
    click.echo(markdown(tree) if form == "markdown" else man_page(tree, tool_version()), nl=False)
