"""Which few columns explain most, taken one after the other: each pays for its size and for having been chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.search.gram import COLLINEAR, Gram, Ints
from sim_backend.linear import Array

MOST = 6
"""Columns at most: as many numbers as three causes have."""


@dataclass(frozen=True)
class Taken:
    """A column, by its index in those to choose from, with what it explains and costs: twice a logarithm each."""

    which: int
    explains: float
    costs: float


def taken_from(gram: Gram, columns: Ints, may: NDArray[np.bool_], prices: Array) -> list[Taken]:
    """Return those of `columns` (n,) that explain more than they cost, each beside those before it and the nuisances.

    Only those that `may` (n,) are taken; each costs its share of `prices` (n,) beside that of one among n.
    """
    products, before = gram.without(gram.nuisance_columns()).copy(), np.diag(gram.products)
    chosen, remaining = 2.0 * float(np.log(max(columns.size, 1))) + prices, float(products[0, 0])
    found: list[Taken] = []
    for _ in range(MOST if columns.size else 0):
        left = np.diag(products)[columns]
        live = may & (left > COLLINEAR * np.maximum(before[columns], np.finfo(float).tiny))
        drops = np.where(live, products[columns, 0] ** 2 / np.where(live, left, 1.0), 0.0)
        gains = gram.ratios(drops, remaining)
        i = int(np.argmax(gains - chosen))
        gain, price = float(gains[i]), float(chosen[i])
        if not gain > price:
            break
        found.append(Taken(i, gain, price + float(np.log1p(gain))))
        remaining -= float(drops[i])
        own = products[:, columns[i]].copy()
        products -= np.outer(own, own) / own[columns[i]]
    return found


def other_than(gram: Gram, columns: Ints, groups: Sequence[Ints], same: float) -> NDArray[np.bool_]:
    """Return which of `columns` (n,) differ from all that `groups` span by more than `same` of their energy.

    The part that is collinear with the nuisances counts for neither.
    """
    alone = np.diag(gram.without(gram.nuisance_columns()))[columns]
    beside = np.diag(gram.without(np.concatenate([gram.nuisance_columns(), *groups])))[columns]
    return np.asarray(beside > same * alone)
