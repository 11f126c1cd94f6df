"""What was found is compared with an unlisted torque that replaces it and is fitted with as much effort.

One listed cause may be the confounder of an unlisted one, or two or three may share it. And where no period repeats,
the noise is the residual of a fit and absorbs whatever that misses: only another fit can show it. The unlisted torque
is a few terms of command, position and rate, those that explain most; a term that is an effect itself, in other words,
is left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.candidates.signature import Scales, as_simulated, enumerate_candidates
from analysis.diagnosis.fitting.balance import again, iterated_gls, score
from analysis.diagnosis.fitting.discrepancy import form_error
from analysis.diagnosis.fitting.fit import Fit
from analysis.diagnosis.search.extension import extended
from analysis.diagnosis.search.forward import other_than, taken_from
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.screening import gram_of
from analysis.diagnosis.search.shortlist import beside, views_of
from analysis.diagnosis.search.stage import Progress
from sim_backend.effects.base import Effect, Site
from sim_backend.effects.unlisted_torque import UnlistedTorque

_AT = 0.86
"""Share of the whole diagnosis that is done when this begins."""


def against_unlisted_alternatives(found: Found, scales: Scales, progress: Progress) -> Found:
    """Return `found` with the lead of its best fit over an unlisted torque wherever one could stand for it."""
    leads, places = [], _questioned(found)
    own = _own_score(found) if places else 0.0
    for place in places:
        progress(f"fitting a force that is not a listed cause at {place}", _AT)
        alternative = _alternative(found, place, scales, own)
        if alternative is None:
            continue
        lead = _lead(found, *alternative, own)
        if lead < 0.0 or not _stands_alone(found, place):
            leads.append((place, lead))
    return replace(found, unlisted_leads=tuple(leads))


def _own_score(found: Found) -> float:
    """Return the score of the best fit with the noise of its own residual, after as many rounds as the other has."""
    known = found.setting.whitener.repeats
    return score(found.best if known else iterated_gls(found.setting, found.best)[1], known)


def _questioned(found: Found) -> Sequence[str]:
    """Return the locations of effects that may be an unlisted torque."""
    places = dict.fromkeys(_input_of(e) for e in found.best.effects)
    return [p for p in places if p in found.setting.places.inputs and _in_question(found, p)]


def _stands_alone(found: Found, place: str) -> bool:
    """Tell whether the effect in question at `place` is one torque, beside noise that is known from repetitions.

    A misfit of that shows by itself (`verdict.lack_of_fit`), so terms that are chosen freely have to be better than it:
    where a cause is small they come near it by that freedom.
    """
    return found.setting.whitener.repeats and len(_in_question(found, place)) == 1


def _in_question(found: Found, place: str) -> list[int]:
    """Return the numbers of the effects at `place` that may be an unlisted torque, if any.

    These are its torques, two or more of them, or one beside own noise. Where there are fewer, what changes the model
    there counts as well, if there are two or more in all: modes in unlimited number absorb any unlisted cause.
    Otherwise it is the one torque there, if any.
    """
    there = [i for i, e in enumerate(found.best.effects) if _input_of(e) == place]
    torques = [i for i in there if found.best.effects[i].site <= Site.STRUCTURE]
    if len(torques) >= (2 if found.setting.whitener.repeats else 1):
        return torques
    return there if len(there) >= 2 else torques


def _input_of(effect: Effect) -> str:
    """Return the input at which an effect is a torque, or changes one or its answer; an empty name at a reading."""
    return effect.where.rpartition("->")[2] if effect.site <= Site.STRUCTURE or effect.site is Site.MODEL else ""


def _alternative(found: Found, place: str, scales: Scales, own: float) -> tuple[Fit, float] | None:
    """Return the best fit with an unlisted torque instead of the effects in question at `place`, the others kept.

    The second number is what choosing its terms costs, twice a logarithm. None where no term is worth that.
    """
    setting, best = found.setting, found.best
    gone = _in_question(found, place)
    keep = [i for i in range(len(best.effects)) if i not in gone]
    rest = again(setting, best, keep=keep) if keep else again(setting, found.tuned)
    footing, motions = beside(setting, rest)
    views = views_of(setting, motions, footing.linear)
    candidates_there = enumerate_candidates((UnlistedTorque,), setting.places, views, scales, workers=setting.workers)
    (alternative,) = (c for c in candidates_there if c.where == place)
    if not setting.whitener.repeats:
        # as the basis functions are: a strong colour of the noise looks like motion where nothing repeats
        motions = [as_simulated(motion, setting.data.rate_hz) for motion in motions]
    tried = [alternative, *best.held(gone)[0]]
    (gram,) = gram_of(footing, motions, setting.whitener, tried, workers=setting.workers)
    columns, same = gram.groups[0], max(form_error(best.effects[i]) for i in gone)
    taken = taken_from(gram, columns, other_than(gram, columns, gram.groups[1:], same), np.zeros(columns.size))
    if not taken:
        return None
    terms = sorted(one.which for one in taken)
    names = list(alternative.unit_sizes)
    alternative = replace(alternative, unit_sizes={names[k]: alternative.unit_sizes[names[k]] for k in terms})
    chosen = replace(gram, groups=(columns[terms],), one_sided=(False,), whole=())
    _, sizes = chosen.solve(chosen.without(chosen.nuisance_columns()), [0])
    fit = extended(setting, rest, alternative, sizes, chosen.nuisances_beside([0], sizes))
    costs = 2.0 * len(terms) * float(np.log(columns.size))
    if setting.whitener.repeats:
        return again(setting, fit), costs
    return iterated_gls(setting, fit, own + _price(found, fit) - costs)[1], costs


def _price(found: Found, alternative: Fit) -> float:
    """Return what the effects cost that the best fit has more of: each had to be found among many."""
    return found.first.price * (len(found.best.candidates) - len(alternative.candidates))


def _lead(found: Found, alternative: Fit, costs: float, own: float) -> float:
    """Return by how much the best fit, of this score, leads the alternative's, the costs of the choice included."""
    worse = score(alternative, found.setting.whitener.repeats) + costs - own
    lead = worse / found.inflation - _price(found, alternative)
    return 0.5 * lead if np.isfinite(lead) else np.inf
