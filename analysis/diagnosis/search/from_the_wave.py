"""A rounding begun where the wave that its steps make has led.

The effect of a rounding depends on the motion to a small part of its step, and from a wrong motion no slope leads to
the right one. A smooth effect at the same location finds it: the wave that the steps make. From there the step is
guessed anew. Of an axis that nothing holds, slow noise hides the position in which a record begins by more than a step;
the wave says nothing of it, for it has a phase of its own. So the starts within one step are tried one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.balance import again, iterated_gls, score, sharpened, stepped
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.search.shortlist import Screen, beside, views_of
from sim_backend.effects.base import Dimension, Site

_PARTS = 8
"""Parts of a step by which the start of a free axis is shifted: one of them off, a sawtooth explains nothing."""

_FINEST, _ROUNDS = 0.01, 2
"""Part of a step to which its start is found, and so many times, the step itself in between."""


def with_rounding(setting: Setting, trials: Sequence[Fit], before: Fit, found: Screen) -> list[Fit]:
    """Return `trials` of one more effect than `before`, best first, with a rounding beside a wave over the position.

    From a motion that is wrong by part of a step, a rounding explains nothing in a screening, and is not tried.
    """
    waves = {c.where for c in trials[0].candidates[len(before.candidates) :] if _over_position(c)}
    tried = {c.where for fit in trials for c in fit.candidates if _rounds_a_reading(c)}
    roundings = {c.where: c for c in found.candidates if _rounds_a_reading(c)}
    candidates, sizes = before.held()
    more = [
        refit(setting, [*candidates, roundings[where]], np.append(sizes, 1.0), before.change, steps=0)
        for where in sorted((waves - tried) & set(roundings))
    ]
    return [*trials, *more]


def _rounds_a_reading(candidate: Candidate) -> bool:
    return candidate.effect.whole and candidate.effect.site is Site.READING


def _over_position(candidate: Candidate) -> bool:
    """Tell whether a candidate is an error of the reading with a distance among its shapes, and no rounding."""
    return candidate.effect.site is Site.READING and not candidate.effect.whole and bool(_lengths(candidate))


def _lengths(candidate: Candidate) -> list[str]:
    """Return the names of the shapes that are distances of the reading."""
    own = candidate.effect.parameters()
    return [p.name for p in own if p.name in candidate.shapes and p.dimension == Dimension(y=1)]


def from_the_wave(setting: Setting, trials: Sequence[Fit]) -> tuple[Setting, list[Fit]]:
    """Return `trials`, those with steps at the best one's location begun from its motion where that is better.

    The records begin as in the best of these.
    """
    known = setting.whitener.repeats
    best = min(trials, key=lambda f: score(f, known))
    places = {c.where for c in best.candidates}

    def begun(fit: Fit) -> Fit:
        if fit is best or not stepped(fit) or not places & {c.where for c in fit.candidates}:
            return fit
        n = len(setting.nuisances)
        there = replace(setting, states=best.states, begin=best.change[:n])
        found = again(there, replace(fit, change=best.change[: fit.change.size]), steps=0)
        for i, candidate in enumerate(fit.candidates):
            if _rounds_a_reading(candidate) and candidate.where in places:
                starts = [(there, found), *_anew(there, found, i, _distances(best, candidate.where))]
                there, found = _closer(*min(starts, key=lambda pair: pair[1].misfit), i)
        other = sharpened(there, found) if known else iterated_gls(there, sharpened(there, found))[1]
        return min(fit, other, key=lambda f: score(f, known))

    found = [begun(fit) for fit in trials]
    leads = min(found, key=lambda f: score(f, known))
    return (setting if leads is best else replace(setting, states=leads.states)), found


def _distances(fit: Fit, where: str) -> list[float]:
    """Return the distances after which the waves over the position of a reading repeat."""
    waves = [(c, e) for c, e in zip(fit.candidates, fit.effects, strict=True) if c.where == where and _over_position(c)]
    return [getattr(effect, name) for candidate, effect in waves for name in _lengths(candidate)]


def _anew(setting: Setting, fit: Fit, i: int, distances: Sequence[float]) -> Iterator[tuple[Setting, Fit]]:
    """Yield `fit` with the steps that rounding number `i` may have, and the setting with every start there may be.

    The steps are those that the residual shows, and `distances`.
    """
    candidates, sizes = fit.held()
    change = fit.change[: len(setting.nuisances)]
    rest = [k for k in range(len(candidates)) if k != i]
    without = again(setting, fit, steps=0, keep=rest)
    footing, motions = beside(setting, without)
    view = views_of(setting, motions, footing.linear)[candidates[i].where]
    for step in (*view.rounding_distances(1), *distances):
        own = replace(candidates[i], shapes=dict.fromkeys(candidates[i].shapes, step))
        tried = [*candidates[:i], own, *candidates[i + 1 :]]
        for begin in _starts_within(setting, candidates[i].where, step):
            yield begin, refit(begin, tried, sizes, change, steps=0)


def _starts_within(setting: Setting, where: str, step: float) -> Iterator[Setting]:
    """Yield the setting, and with the starts of a free axis shifted by parts of a step of its reading `where`."""
    yield setting
    for part in range(1, _PARTS):
        yield from _shifted(setting, where, step * part / _PARTS)


def _shifted(setting: Setting, where: str, by: float) -> list[Setting]:
    """Return the setting with every start of a free axis shifted `by` so much of its reading; none if it is held."""
    nominal = setting.nominal
    shown = nominal.c[setting.places.outputs.index(where)]
    free = np.flatnonzero((nominal.omega_rad_s == 0.0) & (shown != 0.0))
    if not free.size:
        return []
    states = [some.copy() for some in setting.states]
    for some in states:
        some[free[0], 0] += by / shown[free[0]]
    return [replace(setting, states=tuple(states))]


def _closer(setting: Setting, fit: Fit, i: int) -> tuple[Setting, Fit]:
    """Return setting and fit with the start of a free axis and the step of rounding number `i` halved in on.

    Beside its place a sawtooth loses in proportion to the distance, and twelve times that part of what it explains.
    """
    for _ in range(_ROUNDS):
        part = 1.0 / _PARTS
        while part > _FINEST:
            part *= 0.5
            candidates, sizes = fit.held()
            step = getattr(fit.effects[i], next(iter(candidates[i].shapes)))
            change = fit.change[: len(setting.nuisances)]
            tried = [(setting, fit)]
            for by in (-part * step, part * step):
                for begin in _shifted(setting, candidates[i].where, by):
                    tried.append((begin, refit(begin, candidates, sizes, change, steps=0)))
            setting, fit = min(tried, key=lambda pair: pair[1].misfit)
        fit = sharpened(setting, fit)
    return setting, fit
