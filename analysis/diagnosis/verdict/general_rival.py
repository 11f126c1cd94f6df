"""What was found is held against general ways: do a few of their columns explain more than the listed causes do?

The name of a neighbour takes nearly all of what a cause outside the library does, and where it leaves little nothing is
left to object to. Asked the other way round there is more to see: of what was there *before* the neighbour was found,
general ways may explain more, and with fewer numbers. Each column that is taken pays for having been chosen among all,
and for its size, as a cause pays for its place and its parameters. So a right name, which is the shortest description,
is never behind; what stands for something else is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.fitting.balance import again, score
from analysis.diagnosis.fitting.discrepancy import target_of
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.search.gram import COLLINEAR
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import SURE_LEAD
from analysis.diagnosis.verdict.leftover import Beside, Way, general_ways, in_words
from sim_backend.assembly import Places

_MOST = 6
"""Columns at most: as many numbers as three causes have."""


@dataclass(frozen=True)
class GeneralRival:
    """A few columns of general `ways` in place of some effects, and by which natural logarithm these lead it.

    `gone` are the numbers of the effects. What their form may be wrong by is in the lead.
    """

    gone: tuple[int, ...]
    effects: tuple[str, ...]
    ways: tuple[Way, ...]
    lead: float

    def ahead(self, random: float = 0.0) -> bool:
        """Tell whether it is sure to explain more, beside what `random` causes may be (twice a log-likelihood)."""
        return self.lead < -SURE_LEAD - 0.5 * random

    def behind(self, random: float = 0.0) -> bool:
        """Tell whether it is sure to explain less."""
        return self.lead > SURE_LEAD + 0.5 * random

    def words(self, places: Places) -> str:
        """Return what explains the data better than which effects."""
        named = dict.fromkeys(" at ".join(in_words(*way, places)) for way in self.ways)
        return f"{' and '.join(named)} explains the data better than {' and '.join(self.effects)}"


def general_rivals(setting: Setting, found: Found, *, together: bool = True) -> Iterator[GeneralRival]:
    """Yield general ways in place of all effects of the best fit, if `together`, then in place of each by itself.

    The ways are those at the degrees of freedom where these effects are seen. All are weighed in the noise of
    `setting`, which may be louder than that in which the effects were found.
    """
    if not found.best.candidates:
        return
    best = found.best if setting is found.setting else again(setting, found.best)
    numbers = range(len(best.effects))
    for gone in [*([tuple(numbers)] if together else []), *((i,) for i in numbers if len(numbers) > 1)]:
        keep = [i for i in numbers if i not in gone]
        rest = again(setting, best, keep=keep) if keep else again(setting, found.tuned)
        seen = {target_of(best.effects[i].where) for i in gone}
        gain, ways = _explained(general_ways(setting, rest, repeating=False, at=seen))
        if ways:
            names = tuple(f"{best.effects[i].reported()} at {best.effects[i].where}" for i in gone)
            lead = _worth(found, best, rest, len(gone)) + found.discrepancy.total - gain
            yield GeneralRival(gone, names, ways, 0.5 * lead)


def _worth(found: Found, best: Fit, rest: Fit, effects: int) -> float:
    """Return twice the logarithm of the evidence by which `best` leads `rest`, so many effects having a price.

    Where nothing repeats, in the noise that the best one leaves.
    """
    choices = max(len({c.key for c in found.first.candidates}), 1)
    if found.setting.whitener.repeats:
        lead = score(rest, True) - score(best, True)
    else:
        lead = best.rows * float(np.log(rest.objective / best.objective)) + 2.0 * (rest.occam - best.occam)
    return lead - 2.0 * effects * float(np.log(choices))


def _explained(there: Beside) -> tuple[float, tuple[Way, ...]]:
    """Return what the best few columns are worth (twice a logarithm), prices paid, and the ways that they are of.

    One after the other, each beside those before it and the nuisances.
    """
    gram = there.gram
    if not gram.groups:
        return 0.0, ()
    products, before = gram.without(gram.nuisance_columns()).copy(), np.diag(gram.products)
    columns = np.concatenate(gram.groups)
    way_of = np.repeat(np.arange(len(gram.groups)), [g.size for g in gram.groups])
    price, remaining = 2.0 * float(np.log(columns.size)), float(products[0, 0])
    worth, total, best, taken = 0.0, 0.0, 0, list[Way]()
    for _ in range(_MOST):
        left = np.diag(products)[columns]
        fresh = left > COLLINEAR * np.maximum(before[columns], np.finfo(float).tiny)
        drops = np.where(fresh, products[columns, 0] ** 2 / np.where(fresh, left, 1.0), 0.0)
        i = int(np.argmax(drops))
        gain = float(gram.ratios(drops[i : i + 1], remaining)[0])
        if not gain > price:
            break
        taken.append(there.ways[way_of[i]])
        total += gain - price - float(np.log1p(gain))
        if total > worth:
            worth, best = total, len(taken)
        remaining -= float(drops[i])
        own = products[:, columns[i]].copy()
        products -= np.outer(own, own) / own[columns[i]]
    return worth, tuple(taken[:best])
