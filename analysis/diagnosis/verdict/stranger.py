"""What was found is held against a stranger: a force that is no listed cause, fitted in its place with the same effort.

Two or three listed causes at one place may share out what none of them is. And where no period repeats, the noise is
what a fit leaves, so that whatever it misses passes for noise: only another fit can show it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.candidates.signature import Scales
from analysis.diagnosis.fitting.balance import again, iterated_gls, score
from analysis.diagnosis.fitting.fit import Fit
from analysis.diagnosis.search.extension import extended
from analysis.diagnosis.search.rounds import Found, Progress
from analysis.diagnosis.search.shortlist import Rules, screen
from sim_backend.effects.base import Effect, Site
from sim_backend.effects.unlisted_force import UnlistedForce

_AT = 0.86
"""Share of the whole diagnosis that is done when this begins."""


def beside_strangers(found: Found, rules: Rules, scales: Scales, progress: Progress) -> Found:
    """Return `found` with the lead of its best fit over a stranger at every place where one could stand for it."""
    leads, places = [], _doubtful(found)
    own = _own_score(found) if places else 0.0
    for place in places:
        progress(f"fitting a force that is no listed cause at {place}", _AT)
        stranger = _stranger(found, place, rules, scales, own)
        if stranger is not None:
            leads.append((place, _lead(found, stranger, own)))
    return replace(found, strangers=tuple(leads))


def _own_score(found: Found) -> float:
    """Return the score of the best fit: where its noise is what it leaves, after as many rounds as a stranger has."""
    known = found.setting.whitener.repeats
    return score(found.best if known else iterated_gls(found.setting, found.best)[1], known)


def _doubtful(found: Found) -> Sequence[str]:
    """Return the places at which torques were found that a stranger could be: two or more, or one beside own noise."""
    places = [_torque_at(e) for e in found.best.effects]
    fewest = 2 if found.setting.whitener.repeats else 1
    return [p for p in dict.fromkeys(places) if p in found.setting.places.inputs and places.count(p) >= fewest]


def _torque_at(effect: Effect) -> str:
    """Return the input at which an effect is a torque; an empty name when it is none."""
    return effect.where.rpartition("->")[2] if effect.site in (Site.DRIVE, Site.STRUCTURE) else ""


def _stranger(found: Found, place: str, rules: Rules, scales: Scales, own: float) -> Fit | None:
    """Return the best fit with a stranger instead of all torques that were found at `place`, the other effects kept."""
    setting, best = found.setting, found.best
    keep = [i for i, e in enumerate(best.effects) if _torque_at(e) != place]
    rest = again(setting, best, keep=keep) if keep else again(setting, found.tuned)
    seen = screen(setting, rest, replace(rules, effects=(UnlistedForce,)), scales)
    at = [i for i, c in enumerate(seen.candidates) if c.where == place]
    if not at:
        return None
    fit = extended(setting, rest, seen.candidates[at[0]], seen.sizes[at[0]], seen.nuisances[at[0]])
    if setting.whitener.repeats:
        return again(setting, fit)
    return iterated_gls(setting, fit, own + _price(found, fit))[1]


def _price(found: Found, stranger: Fit) -> float:
    """Return what the effects cost that the best fit has more of: each had to be found among many."""
    return found.first.price * (len(found.best.candidates) - len(stranger.candidates))


def _lead(found: Found, stranger: Fit, own: float) -> float:
    """Return by how much the best fit, of this score, leads a stranger's, the price of every effect included."""
    lead = (score(stranger, found.setting.whitener.repeats) - own) / found.inflation - _price(found, stranger)
    return 0.5 * lead if np.isfinite(lead) else np.inf
