"""Which unlisted laws are kept back: nobody is to look at these while a diagnosis is developed."""

from __future__ import annotations

from hashlib import sha256

from analysis.challenge.second.laws import LAWS

SEED = 20261125
"""Fixed, so that the same laws stay reserved whatever is drawn; chosen before any of them was diagnosed."""


def _rank(name: str) -> str:
    return sha256(f"{SEED} {name}".encode()).hexdigest()


def reserved() -> frozenset[str]:
    """Return the third of the unlisted laws that is made only when asked for, by their digests."""
    pool = sorted((law.name for law in LAWS.values() if law.group == "unlisted"), key=_rank)
    return frozenset(pool[: len(pool) // 3])


def unlisted(*, kept_back: bool) -> tuple[str, ...]:
    """Return the unlisted laws that are kept back, or the others, in the order of their names."""
    aside = reserved()
    return tuple(sorted(x.name for x in LAWS.values() if x.group == "unlisted" and (x.name in aside) == kept_back))
