"""The manual, written from the tree of commands: one page for `man`, one for the documents."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import NamedTuple

import click

from mccdcli.lazy import LazyGroup


class Page(NamedTuple):
    """What is said of one command: its words, how it is called, its text in paragraphs, its options with their help."""

    name: str
    usage: str
    paragraphs: tuple[str, ...]
    examples: tuple[str, ...]
    options: tuple[tuple[str, str], ...]


def pages(tree: LazyGroup) -> Iterator[Page]:
    """Yield the page of every command, in the order of their names."""
    root = click.Context(tree, info_name="mccd")
    for path in tree.paths():
        group: click.Command | None = tree
        ctx = root
        for word in path:
            assert isinstance(group, click.Group)
            group = group.get_command(ctx, word)
            assert group is not None
            ctx = click.Context(group, info_name=word, parent=ctx)
        assert group is not None
        yield _page(group, ctx)


def _page(command: click.Command, ctx: click.Context) -> Page:
    text = inspect.cleandoc(command.help or "").split("\n\n")
    examples = next((part for part in text if part.startswith("\b\nExamples:")), "")
    described = [_unwrapped(part) for part in text if part != examples]
    options = (parameter for parameter in command.get_params(ctx) if isinstance(parameter, click.Option))
    records = (option.get_help_record(ctx) for option in options)
    return Page(
        ctx.command_path,
        " ".join([ctx.command_path, *command.collect_usage_pieces(ctx)]),
        tuple(described),
        tuple(line.strip() for line in examples.splitlines()[2:]),
        tuple(record for record in records if record is not None),
    )


def _unwrapped(paragraph: str) -> str:
    """Return a paragraph on one line, unless its lines are to be kept."""
    if paragraph.startswith("\b\n"):
        return paragraph.removeprefix("\b\n")
    return " ".join(paragraph.split())


def markdown(tree: LazyGroup) -> str:
    """Return the reference of all commands in Markdown."""
    parts = ["# Commands", inspect.cleandoc(tree.help or "")]
    for page in pages(tree):
        parts += [f"## {page.name}", f"```text\n{page.usage}\n```", *map(_escaped, page.paragraphs)]
        if page.examples:
            parts.append("\n".join(["```sh", *page.examples, "```"]))
        rows = [f"| `{_cell(names)}` | {_cell(_escaped(help))} |" for names, help in page.options]
        parts.append("\n".join(["| option | |", "|---|---|", *rows]))
    parts += ["## Exit codes", f"```text\n{inspect.cleandoc(tree.epilog or '').removeprefix(chr(8)).strip()}\n```"]
    return "\n\n".join(parts) + "\n"


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _escaped(text: str) -> str:
    return text.replace("<", "&lt;").replace("*", "\\*").replace("_", "\\_")


def man_page(tree: LazyGroup, version: str) -> str:
    """Return the manual as roff, as `man` reads it."""
    lines = [
        f'.TH MCCD 1 "" "mccd {_roff(version)}" "mccd manual"',
        ".SH NAME",
        f"mccd \\- {_roff(inspect.cleandoc(tree.help or '').splitlines()[0])}",
        ".SH SYNOPSIS",
        "\\fBmccd\\fR \\fICOMMAND\\fR [\\fIOPTION\\fR]...",
        ".SH DESCRIPTION",
        _roff(" ".join(inspect.cleandoc(tree.help or "").split("\n\n")[-1].split())),
        ".SH COMMANDS",
    ]
    for page in pages(tree):
        lines += [f".SS {_roff(page.usage)}", *(f"{_roff(text)}\n.PP" for text in page.paragraphs)]
        for names, help in page.options:
            lines += [".TP", f"\\fB{_roff(names)}\\fR", _roff(" ".join(help.split()))]
        if page.examples:
            lines += [".PP", "Examples:", ".PP", ".nf", ".RS", *map(_roff, page.examples), ".RE", ".fi"]
    epilog = inspect.cleandoc(tree.epilog or "").removeprefix("\b").strip()
    lines += [".SH EXIT STATUS", ".nf", *map(_roff, epilog.splitlines()), ".fi"]
    return "\n".join(lines) + "\n"


def _roff(text: str) -> str:
    """Return text that roff takes literally: its own signs escaped, no line that begins as a request."""
    escaped = text.replace("\\", "\\e").replace("-", "\\-")
    return "\n".join(f"\\&{line}" if line.startswith((".", "'")) else line for line in escaped.splitlines())
