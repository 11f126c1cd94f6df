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

from analysis.diagnosis.fitting.balance import again, iterated_gls, score, sharpened, stepped
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.search.shortlist import beside, views_of
from sim_backend.effects.base import Site

_PARTS = 8
"""Parts of a step by which the start of a free axis is shifted; a sixteenth off, the sawtooth is nine tenths of it."""


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
            if candidate.effect.whole and candidate.effect.site is Site.READING and candidate.where in places:
                there, found = min([(there, found), *_anew(there, found, i)], key=lambda pair: pair[1].misfit)
        other = sharpened(there, found)
        other = other if known else iterated_gls(there, other)[1]
        return min(fit, other, key=lambda f: score(f, known))

    found = [begun(fit) for fit in trials]
    leads = min(found, key=lambda f: score(f, known))
    return (setting if leads is best else replace(setting, states=leads.states)), found


def _anew(setting: Setting, fit: Fit, i: int) -> Iterator[tuple[Setting, Fit]]:
    """Yield `fit` with the steps that rounding number `i` may have, and the setting with every start there may be."""
    candidates, sizes = fit.held()
    change = fit.change[: len(setting.nuisances)]
    rest = [k for k in range(len(candidates)) if k != i]
    without = again(setting, fit, steps=0, keep=rest)
    footing, motions = beside(setting, without)
    view = views_of(setting, motions, footing.linear)[candidates[i].where]
    for step in view.rounding_distances(1):
        own = replace(candidates[i], shapes=dict.fromkeys(candidates[i].shapes, step))
        tried = [*candidates[:i], own, *candidates[i + 1 :]]
        for begin in _starts_within(setting, candidates[i].where, step):
            yield begin, refit(begin, tried, sizes, change, steps=0)


def _starts_within(setting: Setting, where: str, step: float) -> Iterator[Setting]:
    """Yield the setting, and with the starts of a free axis shifted by parts of a step of its reading `where`."""
    yield setting
    nominal = setting.nominal
    shown = nominal.c[setting.places.outputs.index(where)]
    free = np.flatnonzero((nominal.omega_rad_s == 0.0) & (shown != 0.0))
    for part in range(1, _PARTS if free.size else 0):
        states = [some.copy() for some in setting.states]
        for some in states:
            some[free[0], 0] += step * part / _PARTS / shown[free[0]]
        yield replace(setting, states=tuple(states))
