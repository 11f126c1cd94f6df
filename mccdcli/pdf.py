"""What the commands that write a page share to print it as well."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from mccdcli.output import say

F = TypeVar("F", bound=Callable[..., Any])


def pdf_option(name: str) -> Callable[[F], F]:
    """Return a decorator that adds `--pdf`, which the command receives as `pdf`: bool; `name` is the file's.

    Where no PDF can be made the command ends at once, before it measures.
    """
    return click.option(
        "--pdf", is_flag=True, callback=_required, help=f"Also write the page as {name} (pip install 'mccd[pdf]')."
    )


def _required(ctx: click.Context, _param: click.Parameter, pdf: bool) -> bool:
    if pdf and not ctx.resilient_parsing:
        from analysis.pages.pdf import require_pdf

        require_pdf()
    return pdf


def printed(page: Path, target: Path) -> None:
    """Write the PDF of a page and say where."""
    from analysis.pages.pdf import write_pdf

    say(f"mccd: {write_pdf(page, target)}")
