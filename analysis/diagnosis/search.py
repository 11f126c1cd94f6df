"""The search for causes: tune, screen, refit what stands out, screen again for more, drop what is not needed."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.candidates import Candidate, Scales
from analysis.diagnosis.fit import Fit, Setting, linear_of
from analysis.diagnosis.noise import even_weights, whitener_from
from analysis.diagnosis.refit import Problem as Hypothesis
from analysis.diagnosis.refit import refit
from analysis.diagnosis.shortlist import Rules, Screen, screen, shortlist
from analysis.diagnosis.starts import stack_white, starts_of
from analysis.diagnosis.tuning import REACH, imitation, turned
from sim_backend.assembly import retuned
from sim_backend.effects.base import Site
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

MATERIAL = 0.003
"""An effect that explains less than this part of what the others do is not looked for: it may stand for the
difference between our form of a stronger effect and nature's, or for what a simulation in steps cannot do better."""

_TUNED, _SEARCH = 0.05, 0.85
"""Shares of the whole diagnosis that are told as done after the tuning, and given to the search."""

_DRIFTING = 10.0
"""Colour of a residual beyond which it is rather motion than noise."""

_LONG = 25
_ROUNDS, _IN_LINE = 6, 10.0
"""Rounds of refit and noise at most; they end when another gains less than this, in units of twice the evidence."""

_TRUSTED = 3.0
"""Refits start with knobs within this many standard deviations of the nominal model."""


def settle(setting: Setting, fit: Fit, order: int | None = None) -> Setting:
    """Return the setting with noise, start bases and start states brought up to date with `fit`.

    `order` is the longest memory of the noise: none when it is white.
    """
    return settled_by(setting, linear_of(setting, fit), fit.residuals, order)


def settled_by(setting: Setting, linear: ModalModel, residuals: Sequence[Array], order: int | None = None) -> Setting:
    """Return the setting brought up to date with a linear model and what it leaves, (n, n_y) per record."""
    even = setting.whitener.even
    if even:
        whitener = even_weights(setting.data, residuals, even)
    else:
        whitener = whitener_from(setting.data, list(residuals), order=order)
    starts = starts_of(setting.data, linear, whitener)
    found = (
        start.states(stack_white(whitener, record, residual[:, :, None])[:, 0])
        for start, record, residual in zip(starts, setting.data.records, residuals, strict=True)
    )
    states = tuple(_added(old, new) for old, new in zip(setting.states, found, strict=True))
    return replace(setting, whitener=whitener, starts=starts, states=states)


def _added(a: Array, b: Array) -> Array:
    """Return the sum of two sets of states (m, 2); an effect may have added modes to one of them."""
    out = np.zeros((max(a.shape[0], b.shape[0]), 2))
    out[: a.shape[0]] += a
    out[: b.shape[0]] += b
    return out


def tune(setting: Setting, passes: int = 4) -> tuple[Setting, Fit]:
    """Return setting and fit of the nominal model re-tuned, with the noise and the starts that go with it."""
    none = np.zeros(0)
    fit = refit(setting, (), none, np.zeros(len(setting.knobs)))
    for _ in range(passes):
        setting = settle(setting, fit)
        before = fit.objective
        fit = refit(setting, (), none, fit.change)
        if abs(before - fit.objective) < 1e-4 * fit.objective:
            break
    return setting, fit


def score(fit: Fit, known_noise: bool) -> float:
    """Return minus twice the logarithm of the evidence of a fit (Laplace's approximation), up to a constant.

    The price of a parameter is what the data narrowed it by: one that they do not determine costs nothing, and one
    that has to be far from where it is plausible pays for the distance in the fit's penalty. Where nothing repeats,
    colour and level of the noise are part of a hypothesis, and the likelihood is that of its innovations.
    """
    if known_noise:
        return float(fit.objective + 2.0 * fit.occam)
    level = fit.rows * (1.0 + np.log(max(fit.objective, 1e-300) / fit.rows))
    return float(level + fit.log_variance + 2.0 * fit.occam)


@dataclass(frozen=True)
class Found:
    """The outcome of a search: the tuned nominal fit, the best fit, its rivals of any size, and the last screening.

    `explained` is by how much the best fit lowers the sum of squares in units of the noise that it leaves, `strangers`
    by how much its evidence leads (natural logarithm) that of a force at a place which is no listed cause.
    """

    setting: Setting
    tuned: Fit
    best: Fit
    rivals: tuple[Fit, ...]
    first: Screen
    last: Screen
    explained: float
    strangers: tuple[tuple[str, float], ...] = ()


def search(setting: Setting, tuned: Fit, rules: Rules, scales: Scales, progress: Progress) -> Found:
    """Return the best set of effects, by alternating screening and refitting, and all that came near it."""
    best, rivals = tuned, [tuned]
    known = setting.whitener.repeats
    first = last = screen(setting, tuned, rules, scales)
    for depth in range(rules.max_effects):
        least = MATERIAL * _explained(setting, tuned, best)
        stage = _Stage(best, least, _TUNED + _SEARCH * depth / rules.max_effects, _SEARCH / rules.max_effects, progress)
        trials = stage.trials(setting, last)
        if not known and _colour(setting, best) > _DRIFTING:
            # a coloured noise takes what is slow for its own, a force that stays or turns with the motion among it;
            # white noise cannot, so the shapes that stand out against white noise are tried as well
            plain = settle(setting, best, order=0)
            seen = {c.key for f in trials for c in f.candidates}
            trials += [lined_up(plain, f)[1] for f in stage.trials(plain, screen(plain, best, rules, scales), seen)]
        if not trials:
            break
        top = min(trials, key=lambda f: score(f, known))
        if score(top, known) + last.price >= score(best, known):
            rivals += trials
            break
        chosen = sorted(trials, key=lambda f: score(f, known))[:3]
        setting, trials, before = _settled(replace(setting, substeps=rules.substeps), chosen, rivals[0])
        best = min(trials, key=lambda f: score(f, setting.whitener.repeats))
        rivals = [*trials, before]
        last = screen(setting, best, rules, scales)
    best, pruned = _pruned(setting, best, first.price)
    explained = _explained(setting, tuned, best)
    return Found(setting, tuned, best, tuple([*rivals, *pruned]), first, last, explained)


def _colour(setting: Setting, fit: Fit) -> float:
    """Return the largest ratio of a residual's size to what its past does not foretell of it."""
    ratios = [
        float(np.sqrt(np.mean(residual[record.fitted(), o] ** 2)) * setting.whitener.taps[o, 0])
        for record, residual in zip(setting.data.records, fit.residuals, strict=True)
        for o in setting.whitener.outputs
        if record.fitted().any()
    ]
    return max(ratios, default=0.0)


@dataclass(frozen=True)
class _Stage:
    """One more effect beside those of `best`: which to try, and where in the whole search that is."""

    best: Fit
    least: float
    done: float
    share: float
    progress: Progress

    def trials(self, setting: Setting, found: Screen, seen: Container[tuple[str, str]] = ()) -> list[Fit]:
        """Return the fits with each effect that stands out, but for those `seen`; none where all is immaterial."""
        picks = [i for i in shortlist(found) if found.candidates[i].key not in seen]
        if not picks or max(found.drops[i] for i in picks) < self.least:
            return []

        def trial(k: int) -> Fit:
            candidate = found.candidates[picks[k]]
            return extended(setting, self.best, candidate, found.sizes[picks[k]], found.knobs[picks[k]])

        fits: list[Fit] = []
        with ThreadPoolExecutor(setting.workers) as pool:
            trials = pool.map(trial, range(len(picks)))
            for k, i in enumerate(picks):
                candidate = found.candidates[i]
                part = self.done + self.share * k / len(picks)
                self.progress(f"fitting {candidate.effect.name} at {candidate.where}", part)
                fits.append(next(trials))
        self.progress("refitting the best", self.done + self.share)
        return fits


def _explained(setting: Setting, tuned: Fit, best: Fit) -> float:
    """Return by how much `best` lowers the sum of squares, in units of the present noise."""
    if not best.candidates:
        return 0.0
    before = Hypothesis(setting, (), []).whiten(tuned.residuals)
    return max(float(before @ before) - best.misfit, 0.0)


def extended(setting: Setting, fit: Fit, candidate: Candidate, sizes: Array, knobs: Array) -> Fit:
    """Return `fit` with one more effect, refitted from its screened `sizes` and the `knobs`' change beside it."""
    before, held = fit.held()
    sd = np.array([k.sd for k in setting.knobs])
    # knobs that stand in for a missing effect have wandered off; once it is there they belong near the nominal model
    start = np.clip(fit.change + knobs[: fit.change.size], -_TRUSTED * sd, _TRUSTED * sd)
    if candidate.effect.site is Site.MODEL:
        linear = turned(setting.nominal, setting.knobs, fit.change)
        units = candidate.unit_sizes
        effect = candidate.made(dict(zip(units, sizes * np.array(list(units.values())), strict=True)))
        # the effect takes over what the knobs did in its place, at any size; one that cannot be (a delay below zero)
        # is left to the fit
        with suppress(ConfigError):
            taken = imitation(linear, setting.knobs, retuned(linear, [effect], setting.places))
            start = np.clip(fit.change - taken, -REACH, REACH)
    return refit(setting, (*before, candidate), np.concatenate([held, sizes]), start)


def _settled(setting: Setting, trials: list[Fit], before: Fit) -> tuple[Setting, list[Fit], Fit]:
    """Return `trials` and the fit `before` them, refitted, and the setting that goes with the best of them.

    Where periods repeat, all are compared under one noise. Without repetition the noise is what a fit itself leaves,
    so each is brought into line with its own.
    """
    if setting.whitener.repeats:
        setting = settle(setting, min(trials, key=lambda f: score(f, True)))
        return setting, [again(setting, f) for f in trials], again(setting, before)
    own = [lined_up(setting, f) for f in trials]
    own.sort(key=lambda pair: score(pair[1], False))
    if _colour(*own[0]) > _DRIFTING:
        # a coloured noise can make its peace with a poor fit: it takes the slow part of what is wrong for its own.
        # White noise cannot, so the best is tried from there as well
        plain = settle(setting, own[0][1], order=0)
        other = lined_up(plain, again(plain, own[0][1], steps=_LONG))
        if score(other[1], False) < score(own[0][1], False):
            own[0] = other
    return own[0][0], [fit for _, fit in own], before


def lined_up(setting: Setting, fit: Fit) -> tuple[Setting, Fit]:
    """Return the setting and the fit in which the noise is what the fit leaves."""
    best = settle(setting, fit), fit
    for _ in range(_ROUNDS):
        setting = settle(setting, fit)
        fit = again(setting, fit)
        gained = np.inf if best[1] is fit else score(best[1], False) - score(fit, False)
        if gained > 0.0:
            best = setting, fit
        if gained < _IN_LINE:
            break
    return best


def again(setting: Setting, fit: Fit, steps: int = 8, keep: Sequence[int] | None = None) -> Fit:
    """Return `fit` refitted: with another noise or start, or with those effects only that are numbered in `keep`."""
    candidates, sizes = fit.held(keep)
    return refit(setting, candidates, sizes, fit.change, steps=steps, exact=True)


def _pruned(setting: Setting, best: Fit, price: float) -> tuple[Fit, list[Fit]]:
    """Return `best` without any effect that its score does not need by `price`, and the fits tried on the way."""
    tried: list[Fit] = []
    known = setting.whitener.repeats
    while len(best.candidates) > 1:
        smaller = []
        for i in range(len(best.candidates)):
            keep = [k for k in range(len(best.candidates)) if k != i]
            smaller.append(again(setting, best, keep=keep))
        tried += smaller
        least = min(smaller, key=lambda f: score(f, known))
        if score(least, known) > score(best, known) + price:
            break
        best = least
    return best, tried
