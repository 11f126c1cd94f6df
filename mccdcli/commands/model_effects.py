"""`mccd model effects`: the library of effects, what each looks like, and its parameters with their units."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from mccdcli.options import common_options
from mccdcli.output import emit, table

if TYPE_CHECKING:
    from sim_backend.effects import Effect


@click.command()
@click.argument("name", metavar="[EFFECT]", required=False)
@common_options("json")
def effects(name: str | None, as_json: bool) -> None:
    """List the effects that a diagnosis can name and a model can hold, or describe one with its parameters.

    Units are those of a bench driven in N m and read in rad; another bench has its own units.

    \b
    Examples:
      mccd model effects
      mccd model effects coulomb-friction
    """
    from sim_backend.effects import effect_class, named

    chosen = named() if name is None else (effect_class(name),)
    described = [_described(effect) for effect in chosen]
    emit({"effects": described}, as_json=as_json, text=_overview(described) if name is None else _one(described[0]))


def _described(effect: type[Effect]) -> dict[str, Any]:
    return {
        "effect": effect.name,
        "named": effect.reported(),
        "family": effect.family,
        "acts_on": effect.site.name.lower(),
        "symptom": effect.symptom,
        "parameters": [
            {
                "name": p.name,
                "unit": p.dimension.unit("N m", "rad"),
                "kind": "size" if p.size else "constant" if p.fixed else "shape",
                "without": p.neutral,
                "meaning": p.about,
            }
            for p in effect.parameters()
        ],
    }


def _overview(described: list[dict[str, Any]]) -> str:
    rows = [
        (d["effect"] if d["effect"] == d["named"] else f"{d['effect']} ({d['named']})", d["family"], d["symptom"])
        for d in described
    ]
    return table(rows, heads=("effect (named)", "where", "the residual …"))


def _one(described: dict[str, Any]) -> str:
    head = f"{described['effect']}: the residual {described['symptom']}."
    where = f"Named {described['named']}; acts on the {described['acts_on']} ({described['family']})."
    rows = [(p["name"], p["unit"], p["kind"], f"{p['without']:g}", p["meaning"]) for p in described["parameters"]]
    return "\n".join([head, where, "", table(rows, heads=("parameter", "unit", "kind", "without it", "meaning"))])
