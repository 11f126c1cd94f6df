"""What one judged case is in the document of a score: all that the score needs of it, so that scores can be pooled."""

from __future__ import annotations

from typing import Any

from analysis.challenge.breakdown import right
from analysis.challenge.judge import Judged
from analysis.challenge.run import Outcome
from analysis.challenge.truth import Buried, Case

SCHEMA = "mccd-challenge-score/3"


def row_of(j: Judged) -> dict[str, Any]:
    """Return a judged case as plain values."""
    return {
        "case": j.name,
        "stratum": j.case.stratum,
        "shape": j.case.shape,
        "axes": j.case.axes,
        "hidden": [
            {
                "effect": e.effect,
                "where": e.where,
                "size": e.size,
                "times_detection": e.size / e.detection_limit,
                "times_naming": e.size / e.naming_limit,
                "twins": [slug for slug, _ in e.twins],
                "law": e.law,
            }
            for e in j.case.effects
        ],
        "verdict": j.verdict,
        "traits": j.case.traits,
        "remainder": j.remainder,
        "right": right(j),
        "found": list(j.found),
        "by_name": list(j.by_name),
        "wrong": [list(key) for key in j.wrong],
        "stated": [probability for probability, _ in j.stated],
        "stated_right": [right for _, right in j.stated],
        "posteriors": [posterior for posterior, _ in j.posteriors],
        "posteriors_right": [right for _, right in j.posteriors],
        "pulls": list(j.pulls),
        "without_std": j.without_std,
        "spreads": list(j.spreads),
        "misses": list(j.misses),
        "held_out": j.held_out,
        "wall_s": j.outcome.wall_s,
        "cpu_s": j.outcome.cpu_s,
        "exit_code": j.outcome.exit_code,
        "tool_version": j.outcome.tool_version,
        "tool_commit": j.outcome.tool_commit,
    }


def judged_of(row: dict[str, Any]) -> Judged:
    """Return the case of a row, as far as a score needs it: parameters and rivals of the truth are left out.

    Raises KeyError, TypeError or ValueError where a row is not of this format.
    """
    hidden = [
        Buried(
            effect=h["effect"],
            where=h["where"],
            parameters={},
            size=h["size"],
            detection_limit=h["size"] / h["times_detection"],
            naming_limit=h["size"] / h["times_naming"],
            rival="",
            twins=[(slug, h["where"]) for slug in h["twins"]],
            law=h.get("law", ""),
        )
        for h in row["hidden"]
    ]
    return Judged(
        name=row["case"],
        case=Case(
            stratum=row["stratum"],
            effects=hidden,
            held_out_floor=0.0,
            shape=row["shape"],
            axes=row["axes"],
            traits=row.get("traits", {}),
        ),
        outcome=Outcome(
            row["case"], row["exit_code"], row["wall_s"], row["cpu_s"], row["tool_version"], row["tool_commit"]
        ),
        verdict=row["verdict"],
        found=tuple(row["found"]),
        by_name=tuple(row["by_name"]),
        wrong=tuple((effect, where) for effect, where in row["wrong"]),
        stated=tuple(zip(row["stated"], row["stated_right"], strict=True)),
        pulls=tuple(row["pulls"]),
        without_std=row["without_std"],
        spreads=tuple(row["spreads"]),
        misses=tuple(row["misses"]),
        held_out=row["held_out"],
        remainder=row.get("remainder"),
        posteriors=tuple(zip(row.get("posteriors", []), row.get("posteriors_right", []), strict=True)),
    )
