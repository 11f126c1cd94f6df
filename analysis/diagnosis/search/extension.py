"""A fit with one more effect: where it starts."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.balance import squares_of
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.problem import Problem, halved
from analysis.diagnosis.fitting.refit import part_to_take, refit, sizes_of_each, taken_over
from analysis.diagnosis.nominal.tuning import bounds_of, spreads_of
from sim_backend.effects.base import Site
from sim_backend.errors import ConfigError
from sim_backend.linear import Array

_TRUSTED = 3.0
"""Refits start with nuisances within this many standard deviations of the nominal model."""


def extended(setting: Setting, fit: Fit, candidate: Candidate, sizes: Array, nuisances: Array) -> Fit:
    """Return `fit` with one more effect, refitted from its screened `sizes` (k,) in units of its columns.

    `nuisances` (n_nuisances,) is their change that goes with it.
    """
    before, held = fit.held()
    sd = spreads_of(setting.nuisances)
    # nuisances that absorbed a missing effect are far off; with the effect in the model they belong near the nominal
    # model
    least, most = bounds_of(setting.nuisances)
    trusted = np.maximum(-_TRUSTED * sd, least), np.minimum(_TRUSTED * sd, most)
    start = np.clip(fit.change + nuisances[: fit.change.size], *trusted)
    if candidate.effect.site is Site.MODEL:
        # the effect replaces what the nuisances absorbed, at any size; one that cannot be (a delay below zero) is left
        # to the fit
        with suppress(ConfigError):
            sizes = sizes * part_to_take(setting, fit, candidate, sizes)
            start = np.clip(taken_over(setting, fit, candidate, sizes)[0], least, most)
    candidates = (*before, candidate)
    found = refit(setting, candidates, np.concatenate([held, sizes]), start)
    near = _nearer(setting, fit, candidates, start, held, sizes)
    if near is not None:
        other = refit(setting, candidates, np.concatenate([held, near[start.size :]]), near[: start.size])
        found = min(found, other, key=lambda f: f.objective)
    return _brought_back(setting, fit, found)


def _brought_back(setting: Setting, before: Fit, found: Fit) -> Fit:
    """Return the fit `found` with the effects of the one `before` it where they were, if that is better.

    The first steps follow the error of the new effect. They may move another one off its optimum, from where no slope
    leads back: a wave's period is found only from within a part of it.
    """
    if not before.candidates:
        return found
    (*_, candidate), sizes = found.held()
    own = sizes_of_each([*before.candidates, candidate], sizes)[-1]
    earlier, held = before.held()
    there = (setting, (*earlier, candidate), np.concatenate([held, own]))
    problem, start = Problem.of(*there)
    if not problem.evaluate(np.concatenate([found.change, start])).objective < found.objective:
        return found
    return min(found, refit(*there, found.change), key=lambda f: f.objective)


def _nearer(
    setting: Setting, fit: Fit, candidates: Sequence[Candidate], start: Array, held: Array, sizes: Array
) -> Array | None:
    """Return nuisances and the new effect's sizes, halved until better than `fit`; None where they are at once.

    Screening is right to first order only. Where nuisances are known poorly it proposes changes so large that first
    order no longer holds. A start may be poor in one of them only: where a size and nuisances multiply, a first step
    corrects what is known well, and leaves the other where screening has put it.
    """
    without = float(np.sum(squares_of(setting, fit.residuals))) + fit.penalty

    def better(there: Array) -> bool:
        problem, own = Problem.of(setting, candidates, np.concatenate([held, there[start.size :]]))
        return problem.evaluate(np.concatenate([there[: start.size], own])).objective < without

    far = np.concatenate([start, sizes])
    near = halved(far, np.concatenate([fit.change, np.zeros(sizes.size)]), better)
    return None if near is far else near
