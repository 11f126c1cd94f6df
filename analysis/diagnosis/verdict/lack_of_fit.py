"""The lack of fit of a hypothesis in general terms: does its residual follow any of the basis functions?

A total of squares over 10⁵ samples cannot show what is in a hundredth of a thousandth of them, and a cause of a hundred
squared standard deviations is no more than that. A few columns that anything of its kind resembles can: along each
function of `basis`, at each location, the residual's part is compared with that of noise, with everything fitted
adjusted beside it. A confounder leaves a part, the right cause does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate, as_simulated, signature
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.noise.levels import BAND_ROWS
from analysis.diagnosis.search.gram import COLLINEAR, Gram
from analysis.diagnosis.search.screening import gathered
from analysis.diagnosis.search.shortlist import beside, views_of
from analysis.diagnosis.side_by_side import side_by_side
from analysis.diagnosis.tails import chi2_tail, f_tail
from analysis.diagnosis.verdict.basis import READINGS, SLOWEST, TORQUES, columns_at, scenes_of
from analysis.diagnosis.verdict.patterns import Pattern, patterns_of
from sim_backend.assembly import Places
from sim_backend.linear import Array, played

ONE_IN_A_MILLION = 1e-6
"""Chance of as much along one function at one location below which it is not noise. Some hundred are tested; what
is beyond that is for small modes below any limit, and for a noise that is known from few periods."""


@dataclass(frozen=True)
class LackOfFit:
    """The part of a residual along one basis function, `what`, at one location.

    `drop` is by how much it lowers the sum of squares, `gain` twice the log-likelihood ratio, `columns` how many live
    columns did it, chosen among so many `choices` by means of the residual, where noise is so much `louder`.
    `known_from` is the number of degrees of freedom of that noise, `shares` how the function shares out over the
    readings.
    """

    what: str
    where: str
    drop: float
    gain: float
    columns: int
    choices: int = 1
    louder: float = 1.0
    known_from: float = math.inf
    shares: tuple[float, ...] = ()

    def p_value(self, allowed: float = 0.0) -> float:
        """Return the chance of as much in noise alone, `allowed` of the gain being put down to random causes."""
        gain = max((self.gain - allowed) / self.louder, 0.0)
        if math.isfinite(self.known_from):
            return min(self.choices * float(f_tail(gain / self.columns, self.columns, self.known_from)), 1.0)
        return min(self.choices * float(chi2_tail(gain, self.columns)), 1.0)

    def words(self) -> str:
        """Return what it is, where, and how sure."""
        return f"{self.what} at {self.where} (chance of as much in noise: {max(self.p_value(), 1e-300):.1g})"


Term = tuple[str, bool, int]
"""What is followed, whether by an error of a reading or by a torque, and the number of that output or input."""


@dataclass(frozen=True)
class Beside:
    """Inner products (`gram`) of the residual of a fit with all basis functions (`terms`) and patterns.

    The groups of the products are those of the terms in their order, then of every pattern and its neighbours, then of
    some effects.
    """

    gram: Gram
    terms: tuple[Term, ...]
    patterns: tuple[Pattern, ...]


def generic_basis(
    setting: Setting,
    fit: Fit,
    *,
    repeating: bool = True,
    at: Container[str] | None = None,
    effects: Sequence[Candidate] = (),
) -> Beside:
    """Return the inner products of what `fit` leaves with all basis functions, and with `repeating` patterns if wanted.

    With `at`, of the functions those at the inputs and readings of these names alone. The signatures of `effects` are
    to first order as the functions are.
    """
    footing, motions = beside(setting, fit)
    if not setting.whitener.repeats:
        # a strong colour of the noise looks like motion where nothing repeats, and would be found again in itself
        motions = [as_simulated(motion, setting.data.rate_hz) for motion in motions]
    scenes, plant = scenes_of(motions, setting.places), played(footing.linear, setting.data.rate_hz)
    places = setting.places
    terms = [(what, False, i) for i in range(len(places.inputs)) for what in TORQUES]
    terms += [(what, True, o) for o in range(len(places.outputs)) for what in READINGS]
    if at is not None:
        terms = [term for term in terms if _place(term, places) in at]
    patterns = list(patterns_of(views_of(setting, motions, footing.linear), places)) if repeating else []
    waves = [wave for p in patterns for wave in (p, *p.neighbours)]

    def columns(r: int) -> Sequence[Array]:
        linear, states, rate_hz = footing.linear, footing.states[r], setting.data.rate_hz
        made = [partial(columns_at, scenes[r], plant, *term) for term in terms]
        made += [partial(wave.columns, motions, r, plant, places) for wave in waves]
        made += [partial(signature, c, linear, places, motions[r], rate_hz, states, r) for c in effects]
        return list(side_by_side(lambda make: make(), made, workers=setting.workers))

    two_sided = (False,) * (len(terms) + len(waves) + len(effects))
    (gram,) = gathered(footing, motions, setting.whitener, columns, two_sided, workers=setting.workers)
    return Beside(gram, tuple(terms), tuple(patterns))


def lacks_of_fit(setting: Setting, fit: Fit) -> tuple[LackOfFit, ...]:
    """Return the lack of fit of `fit` along every basis function at every location, least likely first."""
    there, places = generic_basis(setting, fit), setting.places
    gram = there.gram
    reduced = gram.without(gram.nuisance_columns())

    def left(i: int, what: str, output: bool, at: int, reduced: Array = reduced) -> LackOfFit:
        drop, live = gram.fresh(reduced, gram.groups[i], COLLINEAR)
        gain = float(gram.ratios(np.array([drop]), float(reduced[0, 0]))[0])
        known_from = float(BAND_ROWS) if what in SLOWEST else math.inf
        shares = tuple(gram.shares(i).tolist())
        kind, place = in_words(what, output, at, places)
        return LackOfFit(kind, place, drop, gain, live, known_from=known_from, shares=shares)

    found = [left(i, *term) for i, term in enumerate(there.terms)]
    # a record of a few periods knows its noise badly: where all functions are significant, the noise is underestimated
    everywhere = _loudness(np.median, found)
    at = len(there.terms)
    for pattern in there.patterns:
        of = (pattern.what, pattern.reading, pattern.at)
        without = gram.without(np.concatenate([gram.nuisance_columns(), gram.groups[at]]))
        around = [left(at + k, *of, without) for k in range(1, 1 + len(pattern.neighbours))]
        louder = max(_loudness(np.mean, around), everywhere)
        found.append(replace(left(at, *of), choices=pattern.choices, louder=louder))
        at += 1 + len(around)
    found = [one for one in found if one.columns]
    return tuple(sorted(found, key=lambda one: (one.p_value(), -one.gain)))


def in_words(what: str, output: bool, at: int, places: Places) -> tuple[str, str]:
    """Return a basis function in words, and the name of its location."""
    kind = "an error of the reading" if output else "a torque"
    return f"{kind} that follows {what}", _place((what, output, at), places)


def _place(term: Term, places: Places) -> str:
    _, output, at = term
    return (places.outputs if output else places.inputs)[at]


def _loudness(middle: Callable[[Array], Any], parts: Sequence[LackOfFit]) -> float:
    """Return how many times as strong as unit noise the residual is in the `middle` of some parts, at least once."""
    found = [one.gain / one.columns for one in parts if one.columns]
    return max(1.0, float(middle(np.array(found)))) if found else 1.0
