"""The evidence of every candidate beside a fit, which are significant, and which are worth a refit."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from analysis.diagnosis.candidates.signature import Candidate, Motion, Scales, enumerate_candidates, measured_motion
from analysis.diagnosis.fitting.fit import Fit, Setting, linear_of, positions
from analysis.diagnosis.fitting.refit import exact_sensitivities, plain_sensitivities
from analysis.diagnosis.records.lattice import Lattice
from analysis.diagnosis.search.gram import COLLINEAR, Gram
from analysis.diagnosis.search.matched import wanted_inputs
from analysis.diagnosis.search.screening import Footing, Noise, gram_of
from analysis.diagnosis.tails import chi2_limit
from sim_backend.effects.base import Effect
from sim_backend.effects.periodic_sensor_error import PeriodicSensorError
from sim_backend.effects.view import RecordView
from sim_backend.linear import Array, ModalModel

SURE = 0.99
"""An effect is kept, and a cause named, when there is less than one chance in a hundred that it is another or none."""

SURE_LEAD = float(np.log(SURE / (1.0 - SURE)))
"""The lead in evidence, as a natural logarithm, over all else that this takes."""

MOST = 6
"""Effects at most, however many a location has of one kind."""

_RARE = 0.01
"""How often the best of a cause's starts is larger by chance than what its threshold is set by."""

_SHORTLIST = 5
_ALIKE = 3
"""So many of those that are collinear with the nuisances, or not significant, are refitted at most."""

_NEAR = 0.3
"""Candidates are refitted when their screened evidence is at least this part of the best one's: screening holds
shapes at a few starts, so a true cause with an awkward shape may be far behind there, and far ahead after the refit."""


_OWN_STEP = 1.5
"""A rounding is a sawtooth that repeats at every step; an error that repeats within so many of them is that."""


@dataclass(frozen=True)
class Rules:
    """What the search may try and how sure it has to be: see `analysis.diagnosis.pipeline.Options`.

    First trials take the setting's coarser steps; what they find is fitted again with `substeps` steps per sample.
    `max_effects` counts each effect of which a location may have several, such as modes, once, up to MOST in all.
    `inside` are modal effects, which are searched for where the error of a model is many times the noise. `lattices`
    are the quantisation of the readings of some outputs. Steps are not `refined` where the records show theirs.
    """

    effects: tuple[type[Effect], ...]
    false_alarm: float
    max_effects: int
    substeps: int
    seed: int
    inside: tuple[type[Effect], ...] = ()
    lattices: Mapping[str, Lattice] = field(default_factory=dict)
    refined: bool = True

    def is_rounding(self, candidate: Candidate) -> bool:
        """Tell whether a candidate repeats with the steps of a reading: that is their rounding, which they show."""
        lattice = self.lattices.get(candidate.where)
        if lattice is None or candidate.effect is not PeriodicSensorError:
            return False
        return candidate.shapes["period"] < _OWN_STEP * lattice.step

    def beside(self, found: Sequence[type[Effect]]) -> tuple[type[Effect], ...]:
        """Return the effects that may be added to those `found`."""
        once = sum(not effect.several for effect in found) + len({effect for effect in found if effect.several})
        if len(found) >= MOST or once > self.max_effects:
            return ()
        if once < self.max_effects:
            return self.effects
        return tuple(effect for effect in self.effects if effect.several and effect in found)


@dataclass(frozen=True)
class Screen:
    """One screening: candidates with evidence (twice log-likelihood ratio), sizes, tolerance, and their thresholds.

    `drops` are by how much each lowers the sum of squares, `nuisances` the changes of the nuisances that go with it,
    `shares` (n_y,) how its energy is shared out over the readings, `seen` the sizes in units of the candidates'
    columns, each by itself, from which on noise hides them in less than half of all cases.
    """

    candidates: tuple[Candidate, ...]
    gains: Array
    drops: Array
    sizes: tuple[Array, ...]
    nuisances: tuple[Array, ...]
    tolerance: Array
    threshold: Array
    shares: tuple[Array, ...] = ()
    seen: tuple[Array, ...] = ()

    @property
    def price(self) -> float:
        """Twice the logarithm of the evidence that one more effect needs: to be sure of it, being one of so many."""
        return _price(self.candidates)

    @property
    def top(self) -> float:
        """Evidence of the most significant candidate."""
        return float(np.max(self.gains, initial=0.0))

    def best_per_key(self) -> list[int]:
        """Return the index of the best start of each (effect, location), best first."""
        seen: dict[tuple[str, str], int] = {}
        for i in np.argsort(-self.gains):
            seen.setdefault(self.candidates[i].key, int(i))
        return list(seen.values())


def screen(setting: Setting, fit: Fit, rules: Rules, scales: Scales) -> Screen:
    """Return the evidence of every candidate beside what `fit` already holds."""
    (gram,), candidates = gram_beside(setting, fit, rules, scales)
    return evidence_of(gram, candidates, rules)


def screen_both(
    setting: Setting, other: Setting | None, fit: Fit, rules: Rules, scales: Scales
) -> tuple[Screen, Screen | None]:
    """Return the evidence under the noise of `setting` and under that of `other`, of other levels, if there is one."""
    if other is None:
        return screen(setting, fit, rules, scales), None
    (gram, more), candidates = gram_beside(setting, fit, rules, scales, [(other.whitener, other.starts)])
    return evidence_of(gram, candidates, rules), evidence_of(more, candidates, None)


def gram_beside(
    setting: Setting, fit: Fit, rules: Rules, scales: Scales, others: Sequence[Noise] = ()
) -> tuple[list[Gram], list[Candidate]]:
    """Return the inner products of everything that could be added to `fit`, and the candidates they are of.

    The first are those under the noise of `setting`, then come those under `others`.
    """
    footing, motions = beside(setting, fit)
    views = views_of(setting, motions, footing.linear)
    taken = {c.key for c in fit.candidates if not c.effect.several}
    tried = enumerate_candidates(rules.effects, setting.places, views, scales, workers=setting.workers)
    candidates = [c for c in tried if c.key not in taken and not rules.is_rounding(c)]
    grams = gram_of(footing, motions, setting.whitener, candidates, workers=setting.workers, others=others)
    return grams, candidates


def beside(setting: Setting, fit: Fit) -> tuple[Footing, list[Motion]]:
    """Return what a screening of anything that could be added to `fit` starts from: footing and motions."""
    linear = linear_of(setting, fit)
    motions = [
        measured_motion(record, position, residual, setting.whitener, setting.data.rate_hz)
        for record, position, residual in zip(setting.data.records, positions(setting, fit), fit.residuals, strict=True)
    ]
    exact = exact_sensitivities(setting, fit)
    plain = plain_sensitivities(setting, linear) if fit.effects or setting.known else ()
    data, places, nuisances = setting.data, setting.places, setting.nuisances
    return Footing(data, linear, places, nuisances, fit.change, setting.starts, exact, plain, setting.states), motions


def evidence_of(gram: Gram, candidates: Sequence[Candidate], rules: Rules | None) -> Screen:
    """Return the evidence of each candidate, nuisances adjusted beside it, and the thresholds of chance.

    Without `rules` there are none: the thresholds are infinite.
    """
    reduced = gram.without(gram.nuisance_columns())
    solved = [gram.solve(reduced, [i]) for i in range(len(candidates))]
    # the largest of M chance findings is larger by 2 log M than one of them
    chosen = np.array([2.0 * math.log(max(c.choices, 1)) for c in candidates])
    drops = np.array([drop for drop, _ in solved])
    gains = np.maximum(gram.ratios(drops, float(reduced[0, 0])) - chosen, 0.0)
    threshold = np.full(len(candidates), np.inf)
    if rules is not None:
        ratios = gram.null_ratios(reduced, np.random.default_rng(rules.seed), 2000)
        threshold = thresholds([c.key for c in candidates], ratios, rules.false_alarm)
    sizes = tuple(s for _, s in solved)
    nuisances = tuple(gram.nuisances_beside([i], s) for i, s in enumerate(sizes))
    shares = tuple(gram.shares(i) for i in range(len(candidates)))
    asked = np.maximum(threshold, _price(candidates)) + chosen
    seen = tuple(gram.seen(reduced, i, float(one)) for i, one in enumerate(asked))
    return Screen(tuple(candidates), gains, drops, sizes, nuisances, gram.tolerance(reduced), threshold, shares, seen)


def _price(candidates: Sequence[Candidate]) -> float:
    return 2.0 * (SURE_LEAD + float(np.log(max(len({c.key for c in candidates}), 1))))


def thresholds(keys: Sequence[tuple[str, str]], ratios: Array, false_alarm: float) -> Array:
    """Return the evidence that each candidate must exceed so that noise alone brings any above its own so often.

    `ratios` (n_candidates, draws) are those of noise alone. What is tried in many shapes, or has many sizes, is large
    by chance more often. So each cause at each location has its own threshold: the common limit plus the excess of its
    own 99 % quantile over that of a single known signature. Then it does not raise the limit of the others.
    """
    own = {key: np.max(ratios[[i for i, k in enumerate(keys) if k == key]], axis=0) for key in dict.fromkeys(keys)}
    usual = chi2_limit(_RARE, 1)
    larger = {key: max(float(np.quantile(best, 1.0 - _RARE)) - usual, 0.0) for key, best in own.items()}
    if not own:
        return np.zeros(0)
    limit = np.quantile(np.max([best - larger[key] for key, best in own.items()], axis=0), 1.0 - false_alarm)
    return np.array([float(limit) + larger[key] for key in keys])


def views_of(setting: Setting, motions: Sequence[Motion], linear: ModalModel) -> dict[str, RecordView]:
    """Return what effects may look at when they guess, per degree of freedom, all records joined."""
    places, views = setting.places, {}
    lowest = float(np.min(setting.nominal.omega_rad_s, initial=0.0)) / (2.0 * np.pi)
    temperatures = [m.temperature_k for m in motions]
    joined = (
        None if any(t is None for t in temperatures) else np.concatenate([t for t in temperatures if t is not None])
    )
    ends = tuple(np.cumsum([m.u.shape[0] for m in motions]).tolist())
    wanted, answers = wanted_inputs(setting, linear, [m.residual for m in motions])
    for name in dict.fromkeys((*places.inputs, *places.outputs)):
        i = places.inputs.index(name) if name in places.inputs else 0
        own = name in places.outputs
        along = np.eye(len(places.outputs))[places.outputs.index(name)] if own else places.coordinates[i]
        views[name] = RecordView(
            setting.data.rate_hz,
            np.concatenate([m.u[:, i] for m in motions]),
            np.concatenate([m.position @ along for m in motions]),
            np.concatenate([m.rate @ along for m in motions]),
            np.concatenate([m.residual @ along for m in motions]),
            joined,
            lowest,
            wanted[i],
            answers[i],
            ends,
            np.concatenate([m.sensed @ along for m in motions]),
        )
    return views


def shortlist(found: Screen, allowed: Container[type[Effect]], seen: Container[tuple[str, str]] = ()) -> list[int]:
    """Return the numbers of the candidates that are worth a refit, of `allowed` effects and not `seen`, best first."""
    order = [i for i in found.best_per_key() if found.candidates[i].effect in allowed]
    order = [i for i in order if found.candidates[i].key not in seen]
    significant = [i for i in order if found.gains[i] > found.threshold[i]]
    if not significant:
        return []
    # a candidate that is nearly collinear with the nuisances gains by the penalty that it saves them, and by tiny
    # differences that a refit rarely confirms: which of the kind it is, an inertia or a damping, only a fit can tell
    independent = [i for i in significant if found.tolerance[i] > COLLINEAR]
    limit = _NEAR * found.gains[independent[0]] if independent else 0.0
    collinear = [i for i in significant if i not in independent]
    collinear = [i for i in collinear if found.gains[i] >= _NEAR * found.gains[collinear[0]]][:_ALIKE]
    return [i for i in independent if found.gains[i] >= limit][: _SHORTLIST - len(collinear)] + collinear


def promising(found: Screen, allowed: Container[type[Effect]], seen: Container[tuple[str, str]]) -> list[int]:
    """Return the numbers of the few candidates that lower the squares most, of `allowed` effects and not `seen`.

    Half the price at least: a fit pays for its shapes by itself, and chooses them better than the screening.
    """
    best: dict[tuple[str, str], int] = {}
    for i in np.argsort(-found.drops):
        best.setdefault(found.candidates[i].key, int(i))
    return [
        i
        for key, i in best.items()
        if key not in seen
        and found.candidates[i].effect in allowed
        and found.tolerance[i] > COLLINEAR
        and found.drops[i] > 0.5 * found.price
    ][:_ALIKE]
