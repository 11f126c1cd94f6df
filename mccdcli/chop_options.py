"""What the commands that chop are asked: where, between which positions, under which strategy."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import Any, TypeVar

import click

from mccdcli.options import Real

F = TypeVar("F", bound=Callable[..., Any])

STRATEGIES = (
    "hybrid",
    "mbff",
    "repetitive",
    "learned-hybrid",
    "learned-mbff",
    "designed-linear",
    "designed-modes",
    "designed-hysteresis",
    "designed",
)
"""The names of `campaigns.strategies.STRATEGIES`, which --help shows without importing what plays them."""


class Form(click.ParamType[tuple[float, float]]):
    """The two positions of a chop in mrad, as in `0:+8.5`; converted to rad."""

    name = "form"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[float, float]:
        """Return both positions in rad, else end with a usage error."""
        if isinstance(value, tuple):
            return value
        first, colon, second = str(value).partition(":")
        try:
            positions = float(first) * 1e-3, float(second) * 1e-3
        except ValueError:
            positions = math.nan, math.nan
        if not colon or not all(map(math.isfinite, positions)):
            self.fail(f"{value!r} is not a pair of positions; write both in mrad, as in 0:+8.5", param, ctx)
        return positions


def chop_options(command: F) -> F:
    """Decorator that adds the options of a chop.

    The command receives them as `alpha`: float, `form` (the end points): (float, float) in rad, `strategy`: str,
    `model`: str and `controller`: str | None.
    """
    return reduce(lambda decorated, option: option(decorated), reversed(_OPTIONS), command)


_OPTIONS = (
    click.option(
        "--alpha", type=Real(), default=0.0, show_default=True, help="Direction in degrees: 0 is θx, 90 is θy."
    ),
    click.option("--form", type=Form(), default="0:+8.5", show_default=True, help="Both positions in mrad."),
    click.option(
        "--strategy",
        default="hybrid",
        show_default=True,
        help=f"Control strategy: {', '.join(STRATEGIES)}, or a plug-in's.",
    ),
    click.option(
        "--model", default="design-4th-order", show_default=True, help="Design model: a bundled one or a file."
    ),
    click.option(
        "--controller",
        type=click.Path(exists=True, dir_okay=False),
        metavar="FILE",
        help="Controller that the designed strategies play.  [default: designed now, kept in designed-BENCH]",
    ),
)
