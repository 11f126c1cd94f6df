"""What was found is compared with a generic alternative: do a few basis functions explain more than the listed causes?

A confounder absorbs nearly all of what a cause outside the library does, and where it leaves little, no lack of fit is
seen. The opposite question shows more: of the residual *before* the confounder was found, functions of `basis` may
explain more, and with fewer numbers. Each one that is taken pays for having been chosen among all, and for its size, as
a cause pays for its location and its parameters. So a right name, which is the shortest description, is never behind;
a confounder is.

The model discrepancy of an effect counts in its favour. A column that is the effect itself, in other words, does not
compete with it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.fitting.balance import again, gained
from analysis.diagnosis.fitting.discrepancy import form_error, target_of
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.search.forward import other_than, taken_from
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import SURE_LEAD
from analysis.diagnosis.verdict.lack_of_fit import Beside, Term, generic_basis, in_words
from sim_backend.assembly import Places
from sim_backend.effects.words import placed_text


@dataclass(frozen=True)
class GenericAlternative:
    """A few `terms`, basis functions that replace some effects, and by which natural logarithm these lead it.

    `gone` are the numbers of the effects. Their model discrepancy is included in the lead.
    """

    gone: tuple[int, ...]
    effects: tuple[str, ...]
    terms: tuple[Term, ...]
    lead: float

    def ahead(self, random: float = 0.0) -> bool:
        """Tell whether it is sure to explain more, beside what `random` causes may be (twice a log-likelihood)."""
        return self.lead < -SURE_LEAD - 0.5 * random

    def behind(self, random: float = 0.0) -> bool:
        """Tell whether it is sure to explain less."""
        return self.lead > SURE_LEAD + 0.5 * random

    def words(self, places: Places) -> str:
        """Return what explains the data better than which effects."""
        named = dict.fromkeys(" at ".join(in_words(*term, places)) for term in self.terms)
        return f"{' and '.join(named)} explains the data better than {' and '.join(self.effects)}"


def generic_alternatives(
    setting: Setting, found: Found, *, together: bool = True, repeating: bool = False
) -> Iterator[GenericAlternative]:
    """Yield the basis functions that replace all effects of the best fit, if `together`, then each by itself.

    The functions are those at the degrees of freedom where these effects are seen, and `repeating` patterns if wanted.
    All are weighed in the noise of `setting`, which may be louder than that in which the effects were found.
    """
    if not found.best.candidates:
        return
    best = found.best if setting is found.setting else again(setting, found.best)
    numbers = range(len(best.effects))
    for gone in [*([tuple(numbers)] if together else []), *((i,) for i in numbers if len(numbers) > 1)]:
        keep = [i for i in numbers if i not in gone]
        rest = again(setting, best, keep=keep) if keep else again(setting, found.tuned)
        seen = {target_of(best.effects[i].where) for i in gone}
        there = generic_basis(setting, rest, repeating=repeating, at=seen, effects=best.held(gone)[0])
        same = max(form_error(best.effects[i]) for i in gone)
        lead, terms = _least_lead(found, _own(found, best, rest, len(gone)), _explained(there, same))
        if terms:
            names = tuple(placed_text(best.effects[i], best.effects[i].where) for i in gone)
            yield GenericAlternative(gone, names, terms, lead)


@dataclass(frozen=True)
class _Description:
    """What something explains beside the same rest, and what its numbers and choices cost: twice a logarithm each."""

    explains: float
    costs: float
    terms: tuple[Term, ...] = ()


def _least_lead(found: Found, own: _Description, others: Sequence[_Description]) -> tuple[float, tuple[Term, ...]]:
    """Return the least natural logarithm by which `own` leads one of the `others`, and the terms of that one.

    The model discrepancy of the effects is included in the lead.
    """
    form = found.discrepancy.total
    least, terms = np.inf, tuple[Term, ...]()
    for other in others:
        lead = 0.5 * (own.explains + form - other.explains + other.costs - own.costs)
        if lead < least:
            least, terms = lead, other.terms
    return least, terms


def _own(found: Found, best: Fit, rest: Fit, effects: int) -> _Description:
    """Return what the effects explain of which `best` has so many more than `rest`.

    Where nothing repeats, in the noise that the best one leaves.
    """
    choices = max(len({c.key for c in found.first.candidates}), 1)
    costs = 2.0 * (best.occam - rest.occam) + 2.0 * effects * float(np.log(choices))
    return _Description(gained(rest, best, found.setting.whitener.repeats), costs)


def _explained(there: Beside, same: float) -> list[_Description]:
    """Return what the best one, two, … columns explain, each taken beside those before it and the nuisances.

    Columns that differ from the effects' signatures by less than `same` of their energy are the effects themselves.
    """
    gram, n = there.gram, len(there.terms)
    of, groups, prices = list(there.terms), list(gram.groups[:n]), [0.0] * n
    for pattern in there.patterns:  # its neighbours come after it
        of.append((pattern.what, pattern.reading, pattern.at))
        groups.append(gram.groups[n])
        prices.append(2.0 * float(np.log(max(pattern.choices, 1))))
        n += 1 + len(pattern.neighbours)
    if not of:
        return []
    columns, sizes = np.concatenate(groups), [g.size for g in groups]
    term_of = np.repeat(np.arange(len(of)), sizes)
    other = other_than(gram, columns, gram.groups[n:], same)
    explains, costs, terms, found = 0.0, 0.0, tuple[Term, ...](), list[_Description]()
    for one in taken_from(gram, columns, other, np.repeat(prices, sizes)):
        explains, costs, terms = explains + one.explains, costs + one.costs, (*terms, of[term_of[one.which]])
        found.append(_Description(explains, costs, terms))
    return found
