"""From a search to a verdict: what may be named, what is tied, and when nothing known is good enough."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import scipy

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.balance import gained, score
from analysis.diagnosis.fitting.discrepancy import following, form_error, target_of
from analysis.diagnosis.nominal.tuning import mahalanobis2_of
from analysis.diagnosis.result import Remainder, Verdict
from analysis.diagnosis.search.adequacy import explained_part, uncertainty
from analysis.diagnosis.search.gram import COLLINEAR
from analysis.diagnosis.search.pruning import SEEN, has_seen_model
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import SURE, SURE_LEAD
from analysis.diagnosis.tails import chi2_tail
from analysis.diagnosis.verdict.generic_alternative import GenericAlternative
from analysis.diagnosis.verdict.lack_of_fit import ONE_IN_A_MILLION, LackOfFit
from analysis.diagnosis.verdict.remainder import remainder_of, telling
from sim_backend.effects.base import UNLISTED, Effect, Site
from sim_backend.effects.words import placed_text
from sim_backend.linear import Array

_OVERWHELMING = 10.0
"""A screening errs where the measured motion that it looks along holds the residual itself, but not by so many times
the threshold."""

_NEAR = 0.05
"""So near the limit of a shape, as a part of it, both names that meet there hold."""


@dataclass(frozen=True)
class Judgement:
    """The verdict with the effects that it names, the tied sets, the posterior of the best and the noise inflation.

    `probability` is among the listed causes alone, `general` the least natural logarithm by which the best leads a law
    that is none of them.
    `failed_check` says what of the best model is a lack of fit, or wrong, and makes its verdict *unknown*; `remainder`
    what the effects it names leave above noise.
    """

    verdict: Verdict
    named: tuple[int, ...]
    tied: tuple[tuple[str, ...], ...]
    probability: float
    inflation: float
    rivals: tuple[tuple[str, float], ...]
    failed_check: str = ""
    remainder: Remainder | None = None
    general: float = np.inf

    @property
    def posterior(self) -> float:
        """The posterior of the best among the listed causes and generic alternatives.

        A name is withdrawn where these lead by 99 to 1: a listed cause is so much likelier a priori.
        """
        return float(1.0 / (1.0 / self.probability + np.exp(-self.general - SURE_LEAD)))


def judge(
    found: Found,
    allowed: float = 0.0,
    left: Sequence[LackOfFit] = (),
    random: float = 0.0,
    general: Iterable[GenericAlternative] = (),
) -> Judgement:
    """Return the verdict on the outcome of a search.

    `allowed` is the increase of the whitened residual's mean square that variance effects may cause, and `random` the
    most that they may explain along a few columns (twice a log-likelihood). `left` is the lack of fit along the basis
    functions, least likely first. `general` are the generic alternatives, computed only if no other check fails.
    """
    best, inflation = found.best, found.inflation
    if not best.candidates:
        against = failed_check(found, left, random)
        wrong = against or _loud(found, allowed) or _outstanding(found, random)
        verdict: Verdict = "unknown" if wrong else "consistent"
        return Judgement(verdict, (), (), 1.0, inflation, (), against)
    named = _material(found)
    gaps = _gaps(found, named, inflation)
    weights = np.exp(-np.array([gap for _, gap in gaps]))
    probability = float(1.0 / (1.0 + weights.sum()))
    rivals = tuple(("+".join(label), -gap) for label, gap in gaps)
    rest = remainder_of(found, left, allowed, random)
    against, others = refuted(found), list[GenericAlternative]()
    if not against:
        others = list(general)
        against = _general(found, others, random, rest)
    if against:
        return Judgement("unknown", (), (), probability, inflation, rivals, against)
    lead = min((rival.lead for rival in others), default=np.inf) + 0.5 * random
    names = Judgement("named", named, (), probability, inflation, rivals, remainder=rest, general=lead)
    border = _on_border(found, named)
    if probability >= SURE and border:
        sure = tuple(i for i in named if i not in border)
        return replace(names, verdict="ambiguous", named=sure, tied=tuple(border.values()))
    if probability >= SURE:
        return names
    shared, tied = tie_of(names_of([best.effects[i] for i in named]), gaps)
    sure = tuple(i for i in named if best.effects[i].reported() in shared)
    return replace(names, verdict="ambiguous", named=sure, tied=(tied,))


def tie_of(own: Collection[str], gaps: Sequence[tuple[tuple[str, ...], float]]) -> tuple[set[str], tuple[str, ...]]:
    """Return which names are in the best hypothesis and in all that come near, and which others are in some of them.

    `own` are those of the best; near are the fewest rivals, by rising `gaps`, without which it would be sure.
    """
    weights = np.exp(-np.array([gap for _, gap in gaps]))
    beyond = weights.sum() - np.cumsum(weights)
    close = [set(label) for label, _ in gaps[: 1 + int(np.sum(beyond > (1.0 - SURE) / SURE))]]
    shared = set(own).intersection(*close)
    return shared, tuple(sorted(set().union(own, *close) - shared))


def names_of(effects: Iterable[Effect]) -> tuple[str, ...]:
    """Return the names by which effects are reported, sorted, each once."""
    return tuple(sorted({effect.reported() for effect in effects}))


def failed_check(found: Found, left: Sequence[LackOfFit], random: float = 0.0) -> str:
    """Return why the best model cannot be the whole truth, in words; nothing where it can.

    Either its residual along a basis function exceeds noise and the model discrepancy of its effects, or `refuted`
    gives the reason.
    """
    one = telling(found, left, random)
    return refuted(found) if one is None else f"the residual of the best model holds {one.words()}"


def refuted(found: Found) -> str:
    """Return why the effects of the best model cannot be the cause, whatever their residual; nothing where they can.

    Either an unlisted force explains as much, or the nominal numbers would be beyond their tolerance, or an effect has
    a shape at which it is a confounder.
    """
    equal = [where for where, lead in found.unlisted_leads if lead < SURE_LEAD]
    if equal:
        return (
            f"a torque of command, position and rate at {equal[0]} that is not a listed cause explains the data as well"
        )
    count, off = len(found.setting.nuisances), mahalanobis2_of(found.setting.nuisances, found.best.change)
    # nuisances that the data do not determine absorb the model discrepancy of an effect
    if count and chi2_tail(off - found.discrepancy.total, count) < ONE_IN_A_MILLION:
        return (
            f"the best model needs nominal numbers that are off by {np.sqrt(off / count):.2g} times their tolerance "
            f"(rms of {count})"
        )
    return confounder_in(found.best)


def _general(found: Found, general: Iterable[GenericAlternative], random: float, rest: Remainder | None) -> str:
    """Return which generic alternatives forbid a name, in words; nothing where none does.

    Where the effects leave noise, those that are sure to explain more; where they leave more, those that are not sure
    to explain less: generic alternatives explain the residual of a confounder about as well as the confounder.
    """
    if rest is None:
        return outdone(found, general, random)
    doubt = next((rival for rival in general if not rival.behind(random)), None)
    if doubt is None:
        return ""
    return f"the residual of the best model follows {rest.lives}, and {doubt.words(found.setting.places)}, or as well"


def outdone(found: Found, general: Iterable[GenericAlternative], random: float = 0.0) -> str:
    """Return which generic alternatives surely explain more than effects of the best model, in words; the first found.

    Beside what `random` causes may be. Nothing where none does.
    """
    return next((rival.words(found.setting.places) for rival in general if rival.ahead(random)), "")


class Fitted(Protocol):
    """What a verdict needs of a fit, to records or to a response: its effects, and their fitted parameters."""

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """What the effects began as."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The fitted effects."""

    @property
    def names(self) -> tuple[tuple[int, str], ...]:
        """Number of the effect and name of each fitted parameter."""

    @property
    def values(self) -> Array:
        """Their values in physical units, (n,)."""

    @property
    def std(self) -> Array:
        """Their standard deviations, (n,)."""


def confounder_in(best: Fitted) -> str:
    """Return which effect of a fit is shaped so far beyond what its name says that it stands for another."""
    for effect, candidate in zip(best.effects, best.candidates, strict=True):
        for shape, other in effect.beyond.items():
            value, limit = float(getattr(effect, shape)), candidate.limits.get(shape, (0.0, np.inf))[1]
            if other == UNLISTED and value > (1.0 - _NEAR) * limit:
                return (
                    f"{placed_text(effect, effect.where)} fits best with {shape} {value:.3g}, up to whose limit of "
                    f"{limit:.3g} it has that name: it may stand for what is not in the library"
                )
    return ""


def shortfall(found: Found, judgement: Judgement, allowed: float = 0.0, random: float = 0.0) -> str:
    """Return in words how far the best model of an *unknown* verdict gets, where the size of the noise is known.

    See `judge` for `allowed` and `random`.
    """
    if judgement.verdict != "unknown":
        return ""
    if not found.best.candidates:
        nothing = "the residual is above the noise, and no effect of the library explains a good part of it"
        return "" if judgement.failed_check else _odds(found, allowed, random) or nothing
    if not found.setting.whitener.repeats:
        return ""
    names = " and ".join(placed_text(e, e.where) for e in found.best.effects)
    explains = f"explains {100.0 * explained_part(found):.4g} % of what was more than noise"
    if found.tuned.misfit / found.tuned.rows - 1.0 - allowed <= uncertainty(found):
        explains = "explains a significant part of a residual that may be noise in total"
    return f"the best explanation, {names}, {explains}; it has no name here because of what speaks against it"


def _loud(found: Found, allowed: float) -> bool:
    """Tell whether the model leaves more in all than what differs between periods."""
    excess = found.tuned.misfit / found.tuned.rows - 1.0 - allowed
    return bool(found.setting.whitener.repeats and excess > uncertainty(found) + 0.01)


def _outstanding(found: Found, random: float) -> list[Candidate]:
    """Return the significant candidates where no cause was found, the strongest first.

    `random` of what one promises may be what variance effects have in a few columns.
    """
    last = found.last
    trusted = (last.tolerance > COLLINEAR) | np.array(
        [c.effect.site is Site.MODEL for c in last.candidates], dtype=bool
    )
    gains = last.gains - random
    return [
        last.candidates[i]
        for i in np.argsort(-gains)
        if trusted[i]
        and gains[i] > last.threshold[i]
        and (gains[i] > _OVERWHELMING * last.threshold[i] or _realised(found, last.candidates[i]) > 0.25 * gains[i])
    ]


def _odds(found: Found, allowed: float, random: float) -> str:
    """Return which cause is too weak to be named, with its probability; nothing where none is."""
    known, tuned = found.setting.whitener.repeats, found.tuned
    for candidate in [] if _loud(found, allowed) else _outstanding(found, random):
        fits = [r for r in found.rivals if [c.key for c in r.candidates] == [candidate.key]]
        lead = max((score(tuned, known) - score(r, known) for r in fits), default=0.0)
        # the lead that being sure takes is the first screening's price
        chance = scipy.special.expit(0.5 * (lead - found.first.price) + SURE_LEAD)
        if chance >= SURE:
            return (
                f"{placed_text(candidate.effect, candidate.where)} is above the noise, but none of its sizes is "
                f"{SEEN:g} standard deviations from zero; longer or stronger runs would show it"
            )
        if chance > 1.0 - SURE:
            return (
                f"{placed_text(candidate.effect, candidate.where)} is above the noise and may be the cause, with a "
                f"chance of {100.0 * chance:.2g} %, where a name needs {100.0 * SURE:.0f} %; longer or stronger "
                "runs would decide"
            )
    return ""


def _realised(found: Found, candidate: Candidate) -> float:
    """Return by how much the refit with a candidate alone improved the fit; less than its screening where that erred.

    What was not refitted counts as realised in full.
    """
    known, tuned = found.setting.whitener.repeats, found.tuned
    fits = [r for r in found.rivals if [c.key for c in r.candidates] == [candidate.key]]
    return max((gained(tuned, r, known) for r in fits), default=np.inf)


def _material(found: Found) -> tuple[int, ...]:
    """Return the numbers of the effects that explain enough to be named, from what removing each of them costs."""
    best, known, nuisances = found.best, found.setting.whitener.repeats, found.setting.nuisances
    if len(best.candidates) == 1:
        return (0,)
    whole = {c.key for c in best.candidates}
    costs, spared, nearest = [], [], []
    for c in best.candidates:
        without = [r for r in found.rivals if {x.key for x in r.candidates} == whole - {c.key}]
        # where nothing repeats each fit has a noise of its own, and only their evidence can be compared
        worth = [r.objective - best.objective if known else score(r, False) - score(best, False) for r in without]
        costs.append(min(worth, default=np.inf))
        nearest.append(without[int(np.argmin(worth))] if worth else best)
        # what saves the nuisances more than it explains cannot be another effect's discrepancy
        eased = (mahalanobis2_of(nuisances, r.change) - mahalanobis2_of(nuisances, best.change) for r in without)
        spared.append(known and any(2.0 * ease > w for ease, w in zip(eased, worth, strict=True)))
    places = [target_of(e.where) for e in best.effects]

    def least(i: int, part: float) -> float:
        """Return the model discrepancy of an effect at the same location, along what follows the drive in part."""
        others = zip(best.effects, places, costs, strict=True)
        return max((form_error(e, part) * c for e, p, c in others if p == places[i] and np.isfinite(c)), default=0.0)

    def named(i: int) -> bool:
        if spared[i] or not costs[i] < least(i, 1.0):
            return True
        return costs[i] >= least(i, 0.0) and costs[i] >= least(i, following(found.setting, nearest[i], best, places[i]))

    return tuple(i for i in range(len(costs)) if named(i))


def _on_border(found: Found, named: tuple[int, ...]) -> dict[int, tuple[str, ...]]:
    """Return which of the effects `named` lie so near the limit of their name that another fits them as well, and both.

    What the other is called beyond the limit says the effect.
    """
    tied = {}
    for i in named:
        effect, limits = found.best.effects[i], found.best.candidates[i].limits
        for shape, other in effect.beyond.items():
            value = float(getattr(effect, shape))
            near = any(0.0 < limit < np.inf and abs(value - limit) < _NEAR * limit for limit in limits.get(shape, ()))
            if near and other != UNLISTED:
                tied[i] = tuple(sorted((effect.reported(), other)))
    return tied


def _gaps(found: Found, named: tuple[int, ...], inflation: float) -> list[tuple[tuple[str, ...], float]]:
    """Return rival names with the logarithm of the evidence by which the best one leads, closest first.

    Fits count with their score; candidates that were screened but not refitted count with their screened evidence, as
    rivals of the first effect found. What adds nothing to the model is not a rival: it could not be named.
    """
    known = found.setting.whitener.repeats
    own, reference = names_of([found.best.effects[i] for i in named]), score(found.best, known)
    gaps: dict[tuple[str, ...], float] = {}
    for rival in found.rivals:
        if len(rival.candidates) < len(named) or not rival.candidates or not has_seen_model(rival):
            continue
        label = names_of(rival.effects)
        if set(own) <= set(label):
            continue
        gap = max(0.5 * (score(rival, known) - reference) / inflation, 0.0)
        gaps[label] = min(gaps.get(label, np.inf), gap)
    if len(found.best.candidates) == 1:
        refitted = {c.key for r in found.rivals for c in r.candidates}
        # a screened shape may be far from the fitted one: the best has been fitted, the others may still improve
        shown = found.explained if known else gained(found.tuned, found.best, False)
        top = max(float(np.max(found.first.gains, initial=0.0)), shown)
        # what the nuisances cost less beside the best is part of its evidence
        nuisances = mahalanobis2_of(found.setting.nuisances, found.best.change)
        paid = found.best.occam - found.tuned.occam + 0.5 * (found.best.penalty - nuisances)
        for i in found.first.best_per_key():
            candidate = found.first.candidates[i]
            label = (candidate.effect.reported(),)
            if candidate.key in refitted or label == own or found.first.gains[i] <= 0.0:
                continue
            gain = float(found.first.gains[i])
            screened = max(0.5 * (top - gain) / inflation + _price(candidate, gain) - paid, 0.0)
            # the evidence of the fit is better known than that of the screening
            gap = found.passed[candidate.key] / inflation if candidate.key in found.passed else screened
            gaps[label] = min(gaps.get(label, np.inf), gap)
    return sorted(gaps.items(), key=lambda pair: pair[1])


def _price(candidate: Candidate, gain: float) -> float:
    """Return what the parameters of a candidate that was not refitted cost it, by what its `gain` determines them to.

    A size is known to a part of 1/√gain of itself, a shape to as much of what a unit of its scale does; one that was
    chosen by looking has paid already.
    """
    sizes = max(len(candidate.unit_sizes), 1)
    free = [p for p in candidate.effect.parameters() if not (p.size or p.fixed or p.name in candidate.unit_sizes)]
    shapes = sum(np.log1p(p.spread**2 * gain) for p in free) if candidate.choices == 1 else 0.0
    return float(0.5 * (sizes * np.log1p(gain / sizes) + shapes))
