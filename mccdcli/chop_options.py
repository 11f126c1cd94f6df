"""What the commands that chop are asked: where, between which positions, under which strategy."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import reduce
from typing import Any, TypeVar

import click

from mccdcli.idle_options import refuse_typed
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


SETTINGS = {
    "alpha": ("alpha_deg",),
    "form": ("from_rad", "to_rad"),
    "strategy": ("strategy",),
    "cycles": ("cycles",),
    "frequency": ("frequency_hz",),
    "model": ("model",),
    "controller": ("controller",),
}
"""The settings of the plan that each option chooses."""


def chosen_settings(settings: Mapping[str, Any], **options: Any) -> dict[str, Any]:
    """Return what the `options` of a chop and --set choose together; raises UsageError where one has no effect."""
    for option, names in SETTINGS.items():
        for name in names:
            if name in settings:
                refuse_typed((option,), f"and --set {name} choose the same; leave out one of the two")
    first, second = options.pop("form")
    chosen = {SETTINGS[name][0]: value for name, value in options.items()}
    chosen |= {"from_rad": first, "to_rad": second, **settings}
    if chosen["controller"] is not None or is_designed(chosen["strategy"]):
        refuse_typed(("model",), "has no effect: a controller is played, which has a model of its own; leave it out")
    return chosen


def is_designed(strategy: Any) -> bool:
    """Tell whether a strategy of this name plays a controller file."""
    from campaigns.strategies import STRATEGIES as PLAYED

    return PLAYED.get(str(strategy), "").startswith("designed:")


_OPTIONS = (
    click.option(
        "--alpha", type=Real(), default=0.0, show_default=True, help="Direction in degrees: 0 is θx, 90 is θy."
    ),
    click.option(
        "--form",
        type=Form(),
        default="0:+8.5",
        show_default=True,
        metavar="FROM:TO",
        help="The two end positions in mrad; the settings from_rad and to_rad hold them in rad.",
    ),
    click.option(
        "--strategy",
        default="hybrid",
        show_default=True,
        help=f"Control strategy: {', '.join(STRATEGIES)}, or a plug-in's. hybrid: feed-forward, then feedback. "
        "mbff: both at once. repetitive: the error of a period corrects the next. learned-: what that learned replaces "
        "the feed-forward. designed: a controller of `mccd design`; with a suffix it knows less and does not learn.",
    ),
    click.option(
        "--model",
        default="design-4th-order",
        show_default=True,
        help="Design model, a bundled one or a file, of a strategy that plays no controller.",
    ),
    click.option(
        "--controller",
        type=click.Path(exists=True, dir_okay=False),
        metavar="FILE",
        help="Controller that the designed strategies play. Without it sweeps, rest and hysteresis loops are recorded, "
        "and one is designed from them.  [default: the one kept in designed-BENCH]",
    ),
)
