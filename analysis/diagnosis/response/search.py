"""Search for linear effects of the library in a response: each is screened to first order, fitted, and judged.

The library decides what is tried: every linear effect that acts where its response is known, at every location.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates.signature import Candidate, Scales, places_for, unit_sizes
from analysis.diagnosis.response.fits import Fit, Setting, fit, fit_nominal, slopes
from analysis.diagnosis.result import NOTHING_ADDED
from analysis.diagnosis.search.adequacy import EXPLAINED
from analysis.diagnosis.search.shortlist import SURE, SURE_LEAD
from analysis.diagnosis.search.stage import Progress
from analysis.diagnosis.tails import chi2_tail
from analysis.diagnosis.verdict.judging import Judgement, confounder_in, names_of, tie_of
from analysis.diagnosis.verdict.lack_of_fit import ONE_IN_A_MILLION
from analysis.linear.predicted import changes_the_response
from sim_backend.effects.base import Effect, Parameter
from sim_backend.effects.view import RecordView
from sim_backend.effects.words import placed_text
from sim_backend.errors import ConfigError
from sim_backend.linear import Array

_FREQUENCIES, _TIMES = 80, 12
"""Starts of a shape that is a frequency, and of one that is a time, over the band of the table."""

_SPREADS = (-0.5, 0.0, 0.75, 1.5)
"""Starts of a shape without dimension about its usual value, in standard deviations of its logarithm."""

_BEST = 2
"""Starts of a candidate that are fitted: those that promise most."""

_SMALL = 1e-4
"""Part of a natural size by which an effect is tried for its first order."""

_SUREST = 0.999
"""Highest probability that is stated: causes outside of all hypotheses here have a share of their own."""


@dataclass(frozen=True)
class Found:
    """The tuned nominal model, the best fit, all fits that were made, and how many candidates there were."""

    tuned: Fit
    best: Fit
    fits: tuple[Fit, ...]
    candidates: int


def searched(setting: Setting, effects: Sequence[type[Effect]], most: int, progress: Progress) -> Found:
    """Return what adding effects one by one finds, at most `most`, each at a price that makes it sure."""
    progress("tuning the nominal model", 0.0)
    tuned = fit_nominal(setting)
    keys = [(e, w) for e in effects if changes_the_response(e) for w in places_for(e, setting.predictor.places)]
    best, fits = tuned, [tuned]
    price = SURE_LEAD + float(np.log(max(len(keys), 1)))
    while len(best.candidates) < most:
        progress("comparing effects", 0.1 + 0.2 * len(best.candidates))
        round_ = _beside(setting, best, keys)
        fits += round_
        better = max(round_, key=lambda one: one.evidence, default=best)
        if better.evidence - best.evidence < price:
            break
        best = better
        # an effect that only led the nuisances to better values is no cause
        again = fit_nominal(setting, best.white)
        if again.evidence > tuned.evidence:
            tuned, fits = again, [again, *fits]
            if tuned.evidence + price > best.evidence:
                best = tuned
                break
    if len(best.candidates) > 1:
        progress("exchanging effects", 0.8)
        for without in itertools.combinations(range(len(best.candidates)), len(best.candidates) - 1):
            kept = [best.candidates[i] for i in without]
            base = fit(setting, kept, _sizes_of(best, without), best.white)
            if base is not None:
                fits += [base, *_beside(setting, base, keys)]
        best = max((one for one in fits if len(one.candidates) == len(best.candidates)), key=lambda one: one.evidence)
    return Found(tuned, best, tuple(fits), len(keys))


def _sizes_of(found: Fit, kept: Sequence[int]) -> Array:
    widths = [max(len(c.unit_sizes), 1) for c in found.candidates]
    ends = np.cumsum([0, *widths])
    return np.concatenate([found.sizes[ends[i] : ends[i + 1]] for i in kept])


def _beside(setting: Setting, base: Fit, keys: Sequence[tuple[type[Effect], str]]) -> list[Fit]:
    """Return the best fit of every candidate beside those of `base`."""
    footing = _footing(setting, base)
    there = {(c.effect, c.where) for c in base.candidates}
    found = []
    for effect, where in keys:
        if (effect, where) in there and not effect.several:
            continue
        tried = [
            one
            for candidate, size in _starts(setting, base, footing, effect, where)
            if (one := fit(setting, [*base.candidates, candidate], np.concatenate([base.sizes, size]), base.white))
            is not None
        ]
        if tried:
            found.append(max(tried, key=lambda one: one.evidence))
    return found


@dataclass(frozen=True)
class _Footing:
    """Residual of a fit (rows,), an orthonormal basis of what its parameters absorb (rows, k), and response (n,)."""

    left: Array
    basis: Array
    response: NDArray[np.complex128]


def _footing(setting: Setting, base: Fit) -> _Footing:
    response = setting.modelled(base.linear, base.effects)
    left = setting.whitened(response)

    def of(white: Array) -> Array:
        return setting.whitened(setting.modelled(setting.tuned(white), base.effects))

    bounds = np.full(base.white.size, np.inf)
    moved = slopes(of, base.white, left, -bounds, bounds)
    # the prior of a nuisance is one more row
    whole = np.concatenate([moved, np.eye(base.white.size)])
    basis, _ = np.linalg.qr(whole) if base.white.size else (np.zeros((left.size, 0)), None)
    return _Footing(np.concatenate([left, base.white]), basis, response)


def _starts(
    setting: Setting, base: Fit, footing: _Footing, effect: type[Effect], where: str
) -> list[tuple[Candidate, Array]]:
    """Return the starts of one candidate that promise most, with their sizes in natural units."""
    scored = []
    for candidate in _candidates(setting, effect, where):
        columns = _columns(setting, base, footing, candidate)
        if columns is None:
            continue
        columns = columns - footing.basis @ (footing.basis.T @ columns)
        # at their natural size the columns are as likely as one
        normal = columns.T @ columns + np.eye(columns.shape[1])
        sizes: Array = np.linalg.solve(normal, columns.T @ footing.left).astype(float)
        scored.append((float(sizes @ columns.T @ footing.left), candidate, sizes))
    scored.sort(key=lambda one: -one[0])
    return [(candidate, sizes if candidate.unit_sizes else np.ones(1)) for _, candidate, sizes in scored[:_BEST]]


def _columns(setting: Setting, base: Fit, footing: _Footing, candidate: Candidate) -> Array | None:
    """Return by how much each size of a candidate reduces the residual, to first order, (rows, sizes); None if none."""
    columns = []
    for name in list(candidate.unit_sizes) or [""]:
        for step in (_SMALL, -_SMALL) if name else (1.0,):
            sizes = {n: (step * unit if n == name else 0.0) for n, unit in candidate.unit_sizes.items()}
            try:
                changed = setting.modelled(base.linear, (*base.effects, candidate.made(sizes)))
            except ConfigError:
                continue
            moved = (setting.whitened(footing.response) - setting.whitened(changed)) / step
            if np.any(moved):
                columns.append(np.concatenate([moved, np.zeros(base.white.size)]))
                break
    return np.stack(columns, axis=1) if columns and np.all(np.isfinite(columns)) else None


def _candidates(setting: Setting, effect: type[Effect], where: str) -> list[Candidate]:
    """Return a candidate with every combination of starts of its shapes."""
    lines = setting.lines
    moving = setting.linear.omega_rad_s[setting.linear.omega_rad_s > 0.0]
    seconds = 1.0 / float(np.min(moving, initial=2.0 * np.pi * float(lines.frequency_hz.max())))
    y = float(np.sqrt(np.mean(np.abs(lines.response) ** 2)))
    places = setting.predictor.places
    scales = Scales(np.ones(len(places.inputs)), np.full(len(places.outputs), y), seconds, 10.0)
    units = unit_sizes(effect, where, places, scales)
    view = _view(setting)
    limits = effect.limits(view)
    shapes = [p for p in effect.parameters() if not p.size and not p.fixed]
    fixed = {p.name: p.neutral for p in effect.parameters() if p.fixed}
    starts = [np.clip(_grid(p, setting), *limits.get(p.name, (p.low, p.high))) for p in shapes]
    centres = {p.name: float(np.exp(np.mean(np.log(values)))) for p, values in zip(shapes, starts, strict=True)}
    return [
        Candidate(
            effect,
            where,
            {p.name: float(v) for p, v in zip(shapes, values, strict=True)} | fixed,
            units,
            centres,
            limits=limits,
        )
        for values in itertools.product(*starts)
    ]


def _grid(p: Parameter, setting: Setting) -> Array:
    """Return starts of a shape by its dimension: frequencies and times over the band, else about its usual value."""
    f = setting.lines.frequency_hz
    if p.dimension.s == -1:
        return np.geomspace(f.min(), f.max(), _FREQUENCIES)
    if p.dimension.s == 1:
        return 1.0 / (2.0 * np.pi * np.geomspace(3.0 * f.max(), f.min(), _TIMES))
    return np.asarray((p.neutral or 1.0) * np.exp(p.spread * np.array(_SPREADS)))


def _view(setting: Setting) -> RecordView:
    """Return what a table shows of a record: the band's rate and duration, without samples."""
    f = setting.lines.frequency_hz
    n = int(np.clip(2.0 * f.max() / f.min(), 2, 4096))
    still = np.zeros(n)
    moving = setting.linear.omega_rad_s[setting.linear.omega_rad_s > 0.0]
    lowest = float(moving.min()) / (2.0 * np.pi) if moving.size else 0.0
    return RecordView(2.0 * float(f.max()), still, still, still, still, None, lowest)


def judged(setting: Setting, found: Found) -> Judgement:
    """Return the verdict on what a search found at points of one linear response."""
    best = found.best
    against = _failed_check(setting, found)
    gaps = _gaps(found)
    rivals = tuple(("+".join(label) or NOTHING_ADDED, -gap) for label, gap in gaps)
    if not best.candidates:
        return Judgement("unknown" if against else "consistent", (), (), _SUREST, 1.0, (), against)
    weights = np.exp(-np.array([gap for _, gap in gaps]))
    probability = float(min(1.0 / (1.0 + weights.sum()), _SUREST))
    if against:
        return Judgement("unknown", (), (), probability, 1.0, rivals, against)
    if probability >= SURE:
        return Judgement("named", tuple(range(len(best.effects))), (), probability, 1.0, rivals)
    shared, tied = tie_of(names_of(best.effects), gaps)
    sure = tuple(i for i, effect in enumerate(best.effects) if effect.reported() in shared)
    return Judgement("ambiguous", sure, (tied,), probability, 1.0, rivals)


def _gaps(found: Found) -> list[tuple[tuple[str, ...], float]]:
    """Return rival names with the evidence by which the best leads, closest first; a part of the best is a rival too.

    A set that contains all that the best names and more is not a rival: its prior has cost more than it gained.
    """
    own, gaps = names_of(found.best.effects), dict[tuple[str, ...], float]()
    for one in found.fits:
        label = names_of(one.effects)
        if not set(own) <= set(label):
            gap = max(found.best.evidence - one.evidence, 0.0)
            gaps[label] = min(gaps.get(label, np.inf), gap)
    return sorted(gaps.items(), key=lambda pair: pair[1])


def _failed_check(setting: Setting, found: Found) -> str:
    """Return why the best model cannot be the whole truth, in words; nothing where it can."""
    best, n, dof = found.best, 2 * setting.lines.n, setting.noise.dof
    allowed = 4.0 * np.sqrt(2.0 / n + 2.0 / dof) + 0.002
    excess = best.chi2 / n - 1.0
    before = found.tuned.chi2 / n - 1.0
    explained = 1.0 - excess / before if best.candidates and before > 0.0 else 0.0
    if excess > allowed and explained < EXPLAINED:
        gets = f" and explains {100.0 * explained:.4g} % of what was more ({100.0 * EXPLAINED:g} % are asked for)"
        return (
            f"the best linear model{_names(best)} leaves {best.chi2 / n:.3g} times the mean square of the noise, where "
            f"at most {1.0 + allowed:.3g} may be noise{gets if best.candidates else ''}"
        )
    mahalanobis2, count = float(np.sum(best.white**2)), best.white.size
    if count and chi2_tail(mahalanobis2, count) < ONE_IN_A_MILLION:
        return (
            f"the best linear model{_names(best)} needs nominal numbers that are off by "
            f"{np.sqrt(mahalanobis2 / count):.2g} times their tolerance (rms of {count})"
        )
    return confounder_in(best)


def _names(best: Fit) -> str:
    return f", with {' and '.join(placed_text(e, e.where) for e in best.effects)}," if best.effects else ""


def of_levels(remarks: Sequence[str]) -> Judgement:
    """Return the verdict on a response that depends on the level: no linear effect makes one, so none is named."""
    words = f"the response depends on the level of excitation, as that of no linear model does: {'; '.join(remarks)}"
    return Judgement("unknown", (), (), _SUREST, 1.0, (), words)
