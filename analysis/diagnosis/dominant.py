"""The dominant cause, where the error of a model is many times the noise.

A model fitted to a bench that is far from linear has an error that no refinement could remove, and the noise then says
nothing of what is worth explaining. Instead, all samples have equal weight, and one kind of cause is searched for, at
once at all locations where it is significant: drives and axes are built alike, and with only one of three in the model
the other two still hide it. Each kind is compared with the others and with an unlisted force. Modal effects are
searched for first, and kinds are compared beside them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate, Scales
from analysis.diagnosis.fitting.balance import reestimated_by
from analysis.diagnosis.fitting.discrepancy import Discrepancy
from analysis.diagnosis.fitting.fit import Fit, Setting, left_by
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.modal import in_modes
from analysis.diagnosis.noise.estimate import above_noise, even_weights
from analysis.diagnosis.noise.independent import independent_rows
from analysis.diagnosis.nominal.tuning import bounds_of
from analysis.diagnosis.result import Remainder
from analysis.diagnosis.search.adequacy import chance_of, uncertainty
from analysis.diagnosis.search.gram import Gram
from analysis.diagnosis.search.rounds import Found
from analysis.diagnosis.search.shortlist import SURE, SURE_LEAD, Rules, Screen, evidence_of, gram_beside
from analysis.diagnosis.search.stage import Progress
from analysis.diagnosis.verdict.judging import Judgement
from sim_backend.effects.unlisted_force import UnlistedForce
from sim_backend.effects.words import effect_text
from sim_backend.linear import Array
from sim_backend.modes import is_mode

_TAKES_PART = 0.1
"""A location counts where the cause explains at least this part of what it explains at the best one."""

_FEWEST, _MOST_KINDS, _PRODUCTS = 3, 10, 2e7
"""Kinds that are fitted: those that explain most to first order. Beside a linear model that is wrong by half, first
order says little; so as many are fitted as the limit on samples times adjusted parameters allows."""

_STEPS, _ROUNDS = 6, 5
"""Steps of every kind before they are compared, and how often the best is continued by as many more."""

_RESTLESS = 2.0
"""Residual of the best, as a multiple of the noise, above which other starts are tried as well."""

_NEAREST, _GO_ON = 3, 2
"""Kinds that are tried from other starts before the cause is called unlisted, and fits that are continued."""

_LEAST_GAIN = 0.05
"""A fit that gained less than this part in its last steps has converged."""

_MATERIAL = 0.1
"""Least part of the whole error of the model that a cause beside modal effects explains by itself."""

_LARGE = 5.0
"""Ratio of a residual to repeating noise beyond which the residual is model error and next to no noise."""

_COARSER = 4
"""Factor on the step that a small torque would need: the error of the model is many times the noise."""

_LEAST_SHARE = 0.5
"""Least part of the squared error that the dominant cause explains, and that modal effects explain of its residual."""


@dataclass(frozen=True)
class _Kind:
    """One kind of cause where it is significant, with sizes, nuisances and by how much it lowers the misfit."""

    candidates: tuple[Candidate, ...]
    sizes: Array
    nuisances: Array
    drop: float


def large_discrepancy(setting: Setting) -> tuple[Setting, Fit] | None:
    """Return even weights and the model as it is, where its error on the very data of its fit is many times the noise.

    Its parameters have absorbed the error as far as they can; adjusted again they could only fit the largest samples.
    Delays stay as they were fitted: parts of a sample need a loop that is many times faster, and noise says nothing.
    """
    setting = replace(setting, nuisances=[n for n in setting.nuisances if n.field != "delay_s"])
    setting = reestimated_by(setting, setting.nominal, left_by(setting, setting.nominal, ()))
    residuals = left_by(setting, setting.nominal, ())
    ratio = above_noise(setting.data, residuals)
    if ratio <= _LARGE:
        return None
    data = setting.data.evenly()
    rest = tuple(np.zeros_like(states) for states in setting.states)
    last = [e[-r.n :] for r, e in zip(data.records, residuals, strict=True)]
    whitener = even_weights(data, last, 1.0 / ratio)
    setting = replace(setting, data=data, whitener=whitener, states=rest)
    setting = reestimated_by(setting, setting.nominal, left_by(setting, setting.nominal, ()))
    return setting, refit(setting, (), np.zeros(0), np.zeros(len(setting.nuisances)), steps=0)


def _noises(found: Found) -> float:
    """Return how many times the noise the best fit leaves."""
    return _above(found.setting, found.best)


def _above(setting: Setting, fit: Fit) -> float:
    return float(np.sqrt(fit.misfit / fit.rows) / setting.whitener.even)


def still_large(found: Found) -> bool:
    """Tell whether the residual of the best fit, unlisted forces included, is many times the noise.

    Where it is not, every sample and every refinement counts, and that is another search.
    """
    return _noises(found) > _LARGE


def dominant_cause(setting: Setting, tuned: Fit, rules: Rules, scales: Scales, progress: Progress) -> Found:
    """Return the kind of cause that explains most, its rivals among the other kinds, and the screening.

    Modal effects may be beside it, or replace it. The rivals begin with the best fit itself and with
    its state after as many steps as the other kinds have had.
    """
    setting = replace(setting, substeps=-(-setting.substeps // _COARSER))
    progress("looking into the modes", 0.02)
    rows = _independent_rows(setting, tuned)
    modal = in_modes(setting, tuned, partial(_cost, rows=rows), rules.inside)
    beside = modal or tuned
    progress("screening the kinds of causes", 0.2)
    everything = replace(rules, effects=(*rules.effects, UnlistedForce))
    (gram,), candidates = gram_beside(setting, beside, everything, scales)
    first = evidence_of(gram, candidates, rules)
    more = modal is None or _above(setting, modal) > 1.0  # there is nothing to explain in noise
    kinds = _kinds(gram, candidates, first) if more else []
    fits = [_fitted(setting, beside, kind, 0.3 + 0.3 * k / len(kinds), progress) for k, kind in enumerate(kinds)]
    fits = [fit for fit in fits if np.isfinite(fit.misfit)]  # what cannot be simulated explains nothing
    rows = _independent_rows(setting, min([beside, *fits], key=_misfit))
    fits.sort(key=partial(_cost, rows=rows))
    best = _settled(setting, fits[0], progress) if fits else beside
    if fits and _above(setting, best) > _RESTLESS:
        # an unlisted force is compared with the listed causes from all their starts
        near = _nearest(fits) if _unlisted(best) else [best.effects[0].name]
        others = _from_other_starts(setting, beside, _elsewhere(gram, candidates, first, kinds, near), progress)
        rows = _independent_rows(setting, min([best, *others], key=_misfit))
        if _unlisted(best):
            fits = sorted([best, *others, *fits[1:]], key=partial(_cost, rows=rows))
        best = min([best, *others], key=partial(_cost, rows=rows))
    if modal and fits:
        best = _needed(setting, tuned, modal, best, progress)
    if not fits or all(is_mode(c.where) for c in best.candidates):
        fits = [best]
    worth = tuned.misfit - best.misfit
    return Found(setting, tuned, best, (best, *fits, tuned), first, first, worth, Discrepancy((), (worth,)))


def _fitted(setting: Setting, beside: Fit, kind: _Kind, part: float, progress: Progress) -> Fit:
    """Return the fit of a kind of cause beside what is there already, from its screened start.

    Where that is no better than none, it starts from zero: screening is right to first order only.
    """
    progress(f"fitting {_in_words(kind.candidates)}", part)
    held, sizes = beside.held()
    start = np.clip(beside.change + kind.nuisances[: beside.change.size], *bounds_of(setting.nuisances))
    both = [*kind.candidates, *held]
    fit = refit(setting, both, np.append(kind.sizes, sizes), start, steps=_STEPS, strong=True)
    if fit.misfit < beside.misfit or not held:
        return fit
    return refit(setting, both, np.append(0.0 * kind.sizes, sizes), beside.change, steps=_STEPS, strong=True)


def _nearest(fits: Sequence[Fit]) -> list[str]:
    """Return the names of the listed kinds that came nearest, best first."""
    return [fit.effects[0].name for fit in fits if not _unlisted(fit)][:_NEAREST]


def _elsewhere(
    gram: Gram, candidates: Sequence[Candidate], screen: Screen, kinds: Sequence[_Kind], near: Sequence[str]
) -> list[_Kind]:
    """Return the kinds of some names from every other start of their shapes, as far as there is time."""
    reduced, starts = gram.without(gram.nuisance_columns()), []
    for kind in (k for k in kinds if k.candidates[0].effect.name in near):
        others = [
            sorted(
                (i for i, c in enumerate(candidates) if c.key == one.key and c is not one),
                key=lambda i: -screen.drops[i],
            )
            for one in kind.candidates
        ]
        for together in zip(*others, strict=False):
            starts.append(list(together))
    spare = max(_affordable(gram) - len(kinds), 0)
    return [_kind_of(gram, reduced, candidates, together) for together in starts[:spare]]


def _from_other_starts(setting: Setting, beside: Fit, starts: Sequence[_Kind], progress: Progress) -> list[Fit]:
    """Return the best fits from other starts, after further steps.

    A hysteresis loop that dominates the motion of the axis is screened along a motion that it distorts: to first order
    a wrong one of its shapes is the most significant, and a descent from there may not leave it.
    """
    fits = [_fitted(setting, beside, start, 0.5 + 0.1 * k / len(starts), progress) for k, start in enumerate(starts)]
    return [_settled(setting, fit, progress) for fit in sorted(fits, key=_misfit)[:_GO_ON]]


def _needed(setting: Setting, tuned: Fit, modal: Fit, both: Fit, progress: Progress) -> Fit:
    """Return a cause beside modal effects where both are needed, else the one that is.

    Each must be significant beside the other, and must matter: where every sample counts, a small error of the one is
    evidence for the other. Modal effects must explain most of the cause's own residual; the cause by itself must
    explain a part of the model's whole error.
    """
    within = [i for i, c in enumerate(both.candidates) if is_mode(c.where)]
    alone, rest = (
        refit(setting, *both.held(keep), both.change, steps=_STEPS, strong=True)
        for keep in ([i for i in range(len(both.candidates)) if i not in within], within)
    )
    modal = min(modal, rest, key=_misfit)
    alone = _settled(setting, alone, progress)  # what is beside modal effects had as many steps
    cost = partial(_cost, rows=_independent_rows(setting, min(alone, modal, both, key=_misfit)))
    lead = 2.0 * SURE_LEAD
    if both.misfit > (1.0 - _LEAST_SHARE) * alone.misfit or cost(alone) < cost(both) + lead:
        return alone
    matters = alone.misfit < (1.0 - _MATERIAL) * tuned.misfit
    return both if matters and cost(both) < cost(modal) - lead else modal


def _settled(setting: Setting, fit: Fit, progress: Progress) -> Fit:
    """Return a fit after further steps, until a few more gain little."""
    for again in range(_ROUNDS):
        progress(f"continuing with {_in_words(fit.candidates)}", 0.6 + 0.3 * again / _ROUNDS)
        (held, sizes), before = fit.held(), fit.misfit
        fit = refit(setting, held, sizes, fit.change, steps=_STEPS, strong=True)
        if fit.misfit > (1.0 - _LEAST_GAIN) * before:
            break
    return fit


def _unlisted(fit: Fit) -> bool:
    return bool(fit.effects) and fit.effects[0].reported() == UnlistedForce.name


def _misfit(fit: Fit) -> float:
    return fit.misfit


def _in_words(candidates: Sequence[Candidate]) -> str:
    places: dict[str, list[str]] = {}
    for c in candidates:
        places.setdefault(c.effect.name, []).append(c.where)
    return " and ".join(f"{effect_text(name)} at {', '.join(where)}" for name, where in places.items())


def _cost(fit: Fit, rows: float) -> float:
    """Return twice the negative logarithm of the evidence of a fit to so many independent samples, up to a constant.

    The level of the residual is part of the hypothesis, and each parameter costs half the logarithm of the samples.
    """
    return float(rows * np.log(fit.misfit) + len(fit.values) * np.log(rows))


def _kinds(gram: Gram, candidates: Sequence[Candidate], screen: Screen) -> list[_Kind]:
    """Return the kinds that explain most when each acts at all its locations at once, best first."""
    reduced = gram.without(gram.nuisance_columns())
    per_kind: dict[str, list[int]] = {}
    for i in screen.best_per_key():
        if screen.gains[i] > screen.threshold[i]:
            per_kind.setdefault(candidates[i].effect.name, []).append(i)
    kinds = []
    for found in per_kind.values():
        most = max(screen.drops[i] for i in found)
        together = [i for i in found if screen.drops[i] >= _TAKES_PART * most]
        kinds.append(_kind_of(gram, reduced, candidates, together))
    kinds.sort(key=lambda kind: -kind.drop)
    return kinds[: int(np.clip(_affordable(gram), _FEWEST, _MOST_KINDS))]


def _kind_of(gram: Gram, reduced: Array, candidates: Sequence[Candidate], together: list[int]) -> _Kind:
    """Return the candidates `together` as one kind, the nuisances being taken out of `reduced`."""
    drop, sizes = gram.solve(reduced, together)
    return _Kind(tuple(candidates[i] for i in together), sizes, gram.nuisances_beside(together, sizes), drop)


def _affordable(gram: Gram) -> int:
    """Return how many fits of a few steps are worth their time."""
    return int(_PRODUCTS / max(gram.rows * gram.n_nuisances, 1))


def remainder(found: Found) -> str:
    """Return what a reader has to know of a dominant cause: how much it explains, and whether the rest is noise."""
    part = 1.0 - found.best.misfit / max(found.tuned.misfit, np.finfo(float).tiny)
    return (
        f"the model misses the data it was fitted to by far more than noise; the best explanation takes "
        f"{100.0 * part:.1f} % of the squared error, every record counting alike, and leaves "
        f"{_noises(found):.2g} times the noise"
    )


def judge_dominant(found: Found) -> Judgement:
    """Return the verdict on a dominant cause: named where no other kind, fitted with the same effort, comes near it."""
    best = found.best
    if not best.effects or best.misfit > (1.0 - _LEAST_SHARE) * found.tuned.misfit:
        return Judgement("unknown", (), (), 1.0, 1.0, ())
    own = best.effects[0].reported()
    first = found.rivals[1]
    rows = _independent_rows(found.setting, best)
    gaps: dict[str, float] = {}
    for rival in found.rivals:
        name = rival.effects[0].reported() if rival.effects else own
        if name != own:
            gap = 0.5 * (_cost(rival, rows) - _cost(first, rows))
            gaps[name] = min(gaps.get(name, np.inf), max(gap, 0.0))
    probability = 1.0 / (1.0 + sum(np.exp(-gap) for gap in gaps.values()))
    rivals = tuple(sorted(((name, -gap) for name, gap in gaps.items()), key=lambda pair: -pair[1]))
    inflation = float(found.setting.rows / rows)
    if _unlisted(best):
        places = ", ".join(c.where for c in best.candidates)
        against = f"a smooth force of position and rate at {places} that is not a listed cause explains most of it"
        return Judgement("unknown", (), (), probability, inflation, rivals, against)
    if probability >= SURE:
        named = tuple(range(len(best.effects)))
        return Judgement("named", named, (), probability, inflation, rivals, remainder=_rest(found))
    if rivals[0][0] == UnlistedForce.name:
        return Judgement("unknown", (), (), probability, inflation, rivals)
    tied = tuple(sorted({own, *(n for n, gap in gaps.items() if gap < SURE_LEAD)}))
    return Judgement("ambiguous", (), (tied,), probability, inflation, rivals, remainder=_rest(found))


def _rest(found: Found) -> Remainder | None:
    """Return what a dominant cause leaves; None where that is noise."""
    noises = _noises(found)
    if noises <= 1.0 + uncertainty(found):
        return None
    share = found.best.misfit / max(found.tuned.misfit, np.finfo(float).tiny)
    return Remainder(share, chance_of(found, noises**2 - 1.0), f"all records, {noises:.2g} times the noise")


def _independent_rows(setting: Setting, fit: Fit) -> float:
    """Return how many independent numbers the residual is equivalent to."""
    return sum(
        independent_rows(e)
        for record, residual in zip(setting.data.records, fit.residuals, strict=True)
        for e in residual[record.fitted()].T
    )
