"""A score broken down: by law, by trait of the case, and by the probability that was stated for a name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from analysis.challenge.judge import Judged
from analysis.diagnosis.tails import share_interval

EDGES = (0.0, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.999, 1.0)
"""Ends of the bins of stated probabilities; the last one holds 1."""


@dataclass(frozen=True)
class Group:
    """Cases that have something in common: how many, right ones with their interval, wrong names, what was said."""

    kind: str
    name: str
    n: int
    right: int
    interval: tuple[float, float]
    wrong: int
    said: dict[str, int]


@dataclass(frozen=True)
class Bin:
    """Names that were stated with a probability from `low` to `high`: their mean, how many, and how many are right."""

    low: float
    high: float
    stated: float
    n: int
    right: int
    interval: tuple[float, float]


def right(judged: Judged) -> bool:
    """Tell whether a case came out as it must: consistent, unknown, or the names and no other."""
    said = {"none": "consistent", "outside": "unknown", "unlisted": "unknown"}.get(judged.case.stratum)
    return judged.right if said is None else judged.verdict == said


def laws(judged: Sequence[Judged]) -> tuple[Group, ...]:
    """Return the cases of every law of the second generator by stratum; pairs count for neither law."""

    def key(one: Judged) -> tuple[str, str] | None:
        effects = one.case.effects
        return (one.case.stratum, effects[0].law) if len(effects) == 1 and effects[0].law else None

    return _grouped(judged, lambda one: [key(one)])


def traits(judged: Sequence[Judged]) -> tuple[Group, ...]:
    """Return the cases in groups: for each attribute (family, rate, loop, …) by its value, every case once."""
    return _grouped(judged, lambda one: list(one.case.traits.items()))


def reliability(judged: Sequence[Judged]) -> tuple[Bin, ...]:
    """Return how often names are right by the probability that was stated for them, without empty bins."""
    names = [name for one in judged for name in one.stated]
    bins = []
    for low, high in zip(EDGES, EDGES[1:], strict=False):
        inside = [n for n in names if low <= n[0] and (n[0] < high or high == EDGES[-1])]
        if inside:
            hits = sum(is_right for _, is_right in inside)
            mean = sum(p for p, _ in inside) / len(inside)
            bins.append(Bin(low, high, mean, len(inside), hits, share_interval(hits, len(inside))))
    return tuple(bins)


def _grouped(judged: Sequence[Judged], keys: Callable[[Judged], Sequence[tuple[str, str] | None]]) -> tuple[Group, ...]:
    groups: dict[tuple[str, str], list[Judged]] = {}
    for one in judged:
        for key in keys(one):
            if key is not None:
                groups.setdefault(key, []).append(one)
    return tuple(_group(kind, name, members) for (kind, name), members in sorted(groups.items()))


def _group(kind: str, name: str, members: Sequence[Judged]) -> Group:
    said: dict[str, int] = {}
    for one in members:
        text = "+".join(sorted(effect for effect, _ in one.wrong)) or ("right" if right(one) else one.verdict)
        said[text] = said.get(text, 0) + 1
    hits = sum(right(one) for one in members)
    interval = share_interval(hits, len(members))
    return Group(kind, name, len(members), hits, interval, sum(bool(one.wrong) for one in members), said)
