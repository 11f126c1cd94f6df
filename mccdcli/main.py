"""The entry point `mccd`: the lazy tree of commands, and the only code that converts errors to exit codes."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from io import TextIOWrapper
from typing import Final

import click
from click.shell_completion import shell_complete

from mccdcli.failures import exit_code_of
from mccdcli.freed_memory import keep_freed_memory
from mccdcli.lazy import LazyGroup
from mccdcli.output import warnings_in_one_line
from mccdcli.registry import COMMANDS, GROUPS
from mccdcli.settings import PREFIX, load_settings

COMPLETION_VARIABLE: Final = "_MCCD_COMPLETE"

THREAD_VARIABLES: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""What the libraries under numpy read, once, when it is first imported; a value set by the user stands.

One thread each: our matrices are small, and threads that wait for a busy core cost more than they bring. On four
cores that others were using, a least-squares problem of 3000 × 60 took 4.5 ms with one thread and 950 ms with four.
"""

HELP: Final = """Identify, test and correct the model of a mechatronic bench.

From logs, also imported ones, it shows what the model gets wrong, names the cause and measures what correcting it
gains. It runs test campaigns on a simulated bench or a real one; the bundled one is a cryogenic chopping mirror,
of which it rebuilds the published tables and figures.
"""

EPILOG: Final = """\b
Exit codes:
    0  passed
    1  a test or check failed (diagnose: the verdict is not consistent, or another than --expect)
    2  usage or configuration
    3  hardware
    4  data
   70  a bug in mccd; a file with the details is named
  130  interrupted (141 if the reader of the output went away)

The result goes to standard output, progress and remarks to standard error. NO_COLOR is honoured.
"""


def _print_version(ctx: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not ctx.resilient_parsing:
        from campaigns.version import tool_commit, tool_version

        click.echo(f"mccd {tool_version()} (commit {tool_commit()})")
        ctx.exit()


cli = LazyGroup(
    "mccd",
    COMMANDS,
    GROUPS,
    help=HELP,
    epilog=EPILOG,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    params=[
        click.Option(
            ["--version"],
            is_flag=True,
            is_eager=True,
            expose_value=False,
            callback=_print_version,
            help="Show version and commit, and exit.",
        )
    ],
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command line (default: that of the process) and return its exit code.

    A command returns its exit code or None for success, or raises; nothing it raises passes from here.
    """
    for name in THREAD_VARIABLES:
        os.environ.setdefault(name, "1")
    keep_freed_memory()
    _open_closed_streams()
    if isinstance(sys.stdout, TextIOWrapper):  # a terminal without Greek letters gets \u03b8, not an error
        sys.stdout.reconfigure(errors="backslashreplace")
    with warnings_in_one_line():
        return exit_code_of(lambda: run(cli, _utf8(sys.argv[1:] if arguments is None else list(arguments))))


def _utf8(arguments: list[str]) -> list[str]:
    """Return the words of a command line; raises a usage error for one that is not UTF-8, as logs and reports are."""
    for word in arguments:
        try:
            word.encode("utf-8")
        except UnicodeEncodeError:
            shown = ascii(word[:60])[1:-1]
            raise click.UsageError(f"'{shown}' is not UTF-8, as names in logs and reports are; rename it") from None
    return arguments


def _open_closed_streams() -> None:
    """Connect closed standard streams to the null device; else the first file opened, a log, would get their number."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))


def run(tree: click.Group, arguments: list[str]) -> object:
    """Complete the command line if a shell asks for that, else carry it out; return what the command returns.

    `click.Group.main` would do the same, but ends with 1 when the reader of the output has gone away, and 1
    is the code of a failed check.
    """
    if completing := os.environ.get(COMPLETION_VARIABLE):
        try:
            return shell_complete(tree, {}, "mccd", COMPLETION_VARIABLE, completing)
        except (KeyError, ValueError):  # a shell passes the words of the line in other variables
            raise click.UsageError(
                f"{COMPLETION_VARIABLE} is set, but not what a shell sets beside it; unset it"
            ) from None
    settings = load_settings(GROUPS, COMMANDS)
    with tree.make_context("mccd", arguments, obj=settings, auto_envvar_prefix=PREFIX) as ctx:
        return tree.invoke(ctx)
