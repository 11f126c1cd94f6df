"""`mccd campaign list`: the bundled campaigns, and the plans that a campaign can use."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from inspect import cleandoc
from typing import TYPE_CHECKING, Any, Final

import click

from mccdcli.options import common_options
from mccdcli.output import emit, table

if TYPE_CHECKING:
    from campaigns.plans import Plan

UNITS: Final[Mapping[str, str]] = {
    "s": "s",
    "hz": "Hz",
    "rad": "rad",
    "deg": "°",
    "nm": "N m",
    "n": "N",
    "a": "A",
    "k": "K",
}
"""Units by the last part of the name of a setting."""

WIDEST: Final = 60
"""Characters of a default in the table; the JSON has all of it."""


@click.command("list")
@click.option("--plans", is_flag=True, help="List the plans instead, with settings, defaults and units.")
@common_options("json")
def list_campaigns(plans: bool, as_json: bool) -> None:
    """List the campaigns that come with mccd, or the plans that campaigns are made of.

    \b
    Examples:
      mccd campaign list
      mccd campaign list --plans --json
    """
    from campaigns.plans import all_plans
    from campaigns.playing.campaign import bundled_campaigns, load_campaign

    if plans:
        known = list(all_plans().values())
        described: object = {
            "plans": [{"plan": plan.name, "title": plan.title, "settings": plan().settings()} for plan in known]
        }
        emit(described, as_json=as_json, text="\n\n".join(map(_described, known)))
        return
    loaded = [load_campaign(name) for name in bundled_campaigns()]
    rows = [(c.name, str(len(c.runs)), c.title) for c in loaded]
    result = {"campaigns": [{"name": c.name, "runs": len(c.runs), "title": c.title} for c in loaded]}
    emit(result, as_json=as_json, text=table(rows, heads=("campaign", "runs", "what")))


def _described(plan: type[Plan]) -> str:
    """Return a plan as text: what it plays, then each setting as --set names it, with its default and its unit."""
    rows = []
    for name, value in _by_name(plan().settings()):
        text = _typed(value)
        _, _, last = name.rpartition("_")
        unit = UNITS.get(last, "") if last != name else ""
        rows.append((name, text if len(text) <= WIDEST else f"{text[: WIDEST - 1]}…", unit))
    about = cleandoc(plan.__doc__ or "").replace("`", "").replace("\n\n", "\n")
    parts = [f"{plan.name}: {plan.title}", about, table(rows, heads=("setting", "default", "unit"))]
    return "\n".join(filter(None, parts))


def _by_name(settings: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield every setting, one in a table by the names of both, as in `tuning.learning_s`."""
    for name, value in settings.items():
        if isinstance(value, dict) and value:
            yield from _by_name(value, f"{above}{name}.")
        else:
            yield f"{above}{name}", value


def _typed(value: Any, *, nested: bool = False) -> str:
    """Return a value in TOML, a text without quotes unless it is nested in a list or table."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_typed(one, nested=True) for one in value)}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_typed(one, nested=True)}' for key, one in value.items())} }}"
    if value is None:
        return "none"
    return f'"{value}"' if nested else str(value)
