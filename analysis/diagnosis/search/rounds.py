"""The search for causes: tune, screen, refit the significant ones, screen again, drop what is not needed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from analysis.diagnosis.candidates.signature import Scales
from analysis.diagnosis.fitting.balance import (
    again,
    from_white_noise,
    guessed_squares,
    in_noise,
    iterated_gls,
    reestimated,
    score,
    sharpened,
)
from analysis.diagnosis.fitting.discrepancy import Discrepancy, discrepancy_of, explained_by
from analysis.diagnosis.fitting.fit import Fit, Setting, steps_for, steps_in_noise
from analysis.diagnosis.fitting.refit import LONG
from analysis.diagnosis.search.fading import beside_what_fades
from analysis.diagnosis.search.from_the_wave import from_the_wave, with_rounding
from analysis.diagnosis.search.pruning import has_seen_model, lead_of, needed, pruned
from analysis.diagnosis.search.recorded_steps import with_recorded_steps
from analysis.diagnosis.search.rubbing import rubbing
from analysis.diagnosis.search.shortlist import MOST, SURE_LEAD, Rules, Screen, screen, screen_both, shortlist
from analysis.diagnosis.search.stage import Progress, Stage, added_by, in_units_of


def as_it_is(setting: Setting, fit: Fit) -> Fit:
    """Return `fit`."""
    return fit


_TUNED, _SEARCH = 0.05, 0.85
"""Shares of the progress of the whole diagnosis: done after the tuning, and given to the search."""

_DRIFTING = 10.0
"""Colour of a residual beyond which it is rather motion than noise."""

_MOVING = 2.5
"""Colour of a residual beyond which it is not noise alone. The innovations of a noise of spectrum S have the variance
exp(mean of ln S) (Kolmogorov 1941), so that 1/f noise over six decades has the colour sqrt((ln 1e6 + 1) / e) = 2.3."""

_COMPARED, _CLOSE = 3, 2.0 * SURE_LEAD
"""So many trials of a round are refitted with care; where the noise is not known, also those that trail the best of the
first round by less than this natural logarithm."""

_FINER = 2
"""A fit that needs so many times the steps is repeated with them."""

_OVERRATED, _QUIETER = 0.8, 4
"""A residual below this part of the noise, as a mean square, shows that the noise was overestimated: while a cause is
not yet right, the transient from rest differs between periods as noise does. The noise is then estimated again, at
most so many times."""


@dataclass(frozen=True)
class Found:
    """The outcome of a search: the tuned nominal fit, the best fit, its rivals of any size, and the last screening.

    `explained` is by how much the best fit lowers the sum of squares in units of the noise that it leaves,
    `discrepancy` the part of it that may be model discrepancy of the effects. `passed` gives for each single effect
    that was fitted first its name, its location and the logarithm of the evidence by which it trailed the best of
    them, `unlisted_leads` by how much the best leads an unlisted force at a location.
    """

    setting: Setting
    tuned: Fit
    best: Fit
    rivals: tuple[Fit, ...]
    first: Screen
    last: Screen
    explained: float
    discrepancy: Discrepancy
    passed: dict[tuple[str, str], float] = field(default_factory=dict)
    unlisted_leads: tuple[tuple[str, float], ...] = ()

    @property
    def inflation(self) -> float:
        """How many times the noise the best fit leaves, as a mean square: evidence counts so much less."""
        return max(1.0, self.best.misfit / self.best.rows) if self.setting.whitener.repeats else 1.0


def search(
    setting: Setting,
    tuned: Fit,
    rules: Rules,
    scales: Scales,
    progress: Progress,
    start: Fit | None = None,
    rounds: int = MOST,
    without_noise: Callable[[Setting, Fit], Fit] = as_it_is,
) -> Found:
    """Return the best set of effects, by alternating screening and refitting, and all that came near it.

    It begins with the effects of `start` and adds one in each of at most `rounds`. `without_noise` returns a fit
    without what is noise: where that removes something, the noise is louder than assumed, and the search ends.
    """
    best = tuned if start is None else start
    rivals, known = [best], setting.whitener.repeats
    flat, last, beneath = _screened(setting, best, rules, scales)
    first = last
    passed: dict[tuple[str, str], float] = {}
    for depth in range(rounds):
        least = discrepancy_of(setting, tuned, best)
        # most searches end early: each further effect gets half of the remaining part of the progress
        share = 0.5 ** (depth + 1)
        allowed = rules.beside([c.effect for c in best.candidates])
        if shortlist(last, allowed) and (less := without_noise(setting, best)) is not best:
            best = less
            break
        stage = Stage(best, least, allowed, _TUNED + _SEARCH * (1.0 - 2.0 * share), _SEARCH * share, progress)
        trials = stage.trials(setting, last)
        if not known:
            trials = _in_own_noise(setting, stage, trials, last, rules, scales)
        ahead = [(lead_of(setting, f, best), f) for f in trials]
        if beneath and flat and _top(ahead) <= last.price <= _rise(setting, flat):
            ahead, upheld = _beneath(flat, stage, beneath, last.price, ahead)
            if upheld and not best.candidates:  # causes are compared where they are significant
                first = screen(reestimated(flat, min(upheld, key=lambda f: score(f, True))), best, rules, scales)
        ahead.sort(key=lambda pair: -pair[0])
        if _top(ahead) <= last.price:
            rivals += [f for _, f in ahead]
            if (settled := _settled(setting, best, rivals, tuned, last.price, rules)) is None:
                break
            setting, best, rivals = settled
            flat, last, beneath = _screened(setting, best, rules, scales)
            continue
        if not best.candidates:
            passed = {f.candidates[0].key: 0.5 * (_top(ahead) - lead) for lead, f in ahead}
        # what was passed over is only ever a rival of the first cause
        some = with_rounding(setting, _compared(ahead, known=known or bool(best.candidates)), best, last)
        setting, trials, before = _in_their_steps(setting, some, best, last.price, rules)
        best = sharpened(setting, _best_of(setting, trials, before, last.price))
        best, rivals = with_recorded_steps(setting, best, rules.lattices), [*trials, before]
        flat, last, beneath = _screened(setting, best, rules, scales)
    best, smaller = pruned(setting, whole := best, tuned, first.price)
    if best is not whole:
        setting, best = needed(setting, best)
        last = screen(setting, best, rules, scales)
    explained = explained_by(setting, tuned, best)
    discrepancy = discrepancy_of(setting, tuned, best)
    return Found(setting, tuned, best, tuple([*rivals, *smaller]), first, last, explained, discrepancy, passed)


def _screened(
    setting: Setting, best: Fit, rules: Rules, scales: Scales
) -> tuple[Setting | None, Screen, Screen | None]:
    """Return the setting of `_flat`, and the evidence of what could be added in either noise."""
    flat = _flat(setting, best)
    return flat, *screen_both(setting, flat, best, rules, scales)


def _settled(
    setting: Setting, best: Fit, rivals: Sequence[Fit], tuned: Fit, price: float, rules: Rules
) -> tuple[Setting, Fit, list[Fit]] | None:
    """Return setting, best fit and rivals once noise and fit have settled; None where they had."""
    faded, fit = beside_what_fades(setting, best)
    if faded is setting:
        return None
    setting, (best,), _ = _in_their_steps(faded, [fit], tuned, price, rules)
    return setting, best, [again(setting, f) for f in rivals]


def _beneath(
    flat: Setting, stage: Stage, beneath: Screen, price: float, ahead: Sequence[tuple[float, Fit]]
) -> tuple[list[tuple[float, Fit]], list[Fit]]:
    """Return leads and fits with those that are significant in `flat` noise replacing their like, and these alone."""
    found = _unmasked(flat, stage.best, beneath, price)
    # what slow noise has absorbed may have been significant there as well, by too little
    upheld = _upheld(flat, stage.trials(flat, found), stage.best, price)
    kept = [(lead, f) for lead, f in ahead if not added_by([f]) & added_by(upheld)]
    return kept + [(score(stage.best, True) - score(f, True), f) for f in upheld], upheld


def _in_own_noise(
    setting: Setting, stage: Stage, trials: Sequence[Fit], last: Screen, rules: Rules, scales: Scales
) -> list[Fit]:
    """Return `trials` and those that the noise of a fit without them has hidden."""
    found, colour = [*trials], _colour(setting, stage.best)
    if colour > _DRIFTING:
        found += _against_white_noise(setting, stage, trials, rules, scales)
    if max((lead_of(setting, f, stage.best) for f in found), default=-np.inf) <= last.price:
        found += stage.overlooked(setting, last, found)
    return _closest_in_white_noise(setting, stage.best, found) if found and colour > _MOVING else found


def _closest_in_white_noise(setting: Setting, best: Fit, trials: Sequence[Fit]) -> list[Fit]:
    """Return `trials`, the one that simulates the record most closely refitted from there where that is better.

    While something large is missing, coloured noise absorbs most of it, and a descent in that noise ends far from
    where the record is simulated well. White noise absorbs nothing.
    """
    plain = reestimated(setting, best, order=0)
    closest = min((again(plain, f, steps=LONG) for f in trials), key=lambda f: f.objective)
    found, key = iterated_gls(plain, closest)[1], closest.candidates[-1].key
    return [min(f, found, key=lambda f: score(f, False)) if f.candidates[-1].key == key else f for f in trials]


def _against_white_noise(
    setting: Setting, stage: Stage, trials: Sequence[Fit], rules: Rules, scales: Scales
) -> list[Fit]:
    """Return the fits beside `trials` with shapes that are significant in white noise.

    Coloured noise absorbs what is slow, for example a force that is constant or changes sign with the motion. What
    gained nothing beside that noise may gain here.
    """
    plain = reestimated(setting, stage.best, order=0)
    found = screen(plain, stage.best, rules, scales)
    before = score(stage.best, False)
    seen = added_by([f for f in trials if score(f, False) + found.price < before])
    lowest = min((score(f, False) for f in trials), default=np.inf)
    starts = [[fit] for fit in stage.trials(plain, found, seen)] + rubbing(plain, stage.best, found)
    return [_best_start(plain, some, lowest) for some in starts]


def _best_start(setting: Setting, starts: Sequence[Fit], rival: float) -> Fit:
    """Return the best of several starts of one effect, each with its noise re-estimated; what trails is given up."""
    found: list[Fit] = []
    for fit in starts:
        found.append(iterated_gls(setting, fit, rival)[1])
        rival = min(rival, score(found[-1], False))
    return min(found, key=lambda fit: score(fit, False))


def _compared(ahead: Sequence[tuple[float, Fit]], *, known: bool) -> list[Fit]:
    """Return the trials of a round that are refitted with care, by their leads, largest first."""
    return [fit for _, fit in ahead[: n_compared([lead for lead, _ in ahead], known=known)]]


def n_compared(leads: Sequence[float], *, known: bool) -> int:
    """Return how many trials of a round are refitted with care, by their `leads`, largest first (twice a logarithm).

    Where the noise is what a trial itself leaves, not `known`, one that is close behind may come out far behind or far
    ahead under its own: left where it is it would be tied with the best.
    """
    return _COMPARED if known else max(_COMPARED, sum(leads[0] - lead < 2.0 * _CLOSE for lead in leads))


def _top(ahead: Sequence[tuple[float, Fit]]) -> float:
    """Return the largest lead, minus infinity of none."""
    return max((lead for lead, _ in ahead), default=-np.inf)


def _best_of(setting: Setting, trials: Sequence[Fit], before: Fit, price: float) -> Fit:
    """Return the trial that leads most over the fit `before` them all; see `leading`."""
    leads = [lead_of(setting, f, before) for f in trials]
    return leading(trials, [-lead for lead in leads], -price)


def leading(trials: Sequence[Fit], scores: Sequence[float], enough: float) -> Fit:
    """Return the trial of the lowest score; of those that are lower than `enough`, one that is seen in the model.

    What adds nothing to the model explains by numbers that were tuned beside it, and is dropped in the end; another
    trial that explains enough by itself would be lost behind it.
    """
    pairs = list(zip(scores, trials, strict=True))
    seen = [(value, f) for value, f in pairs if value < enough and has_seen_model(f)]
    return min(seen or pairs, key=lambda pair: pair[0])[1]


def _flat(setting: Setting, fit: Fit) -> Setting | None:
    """Return the setting with noise that does not rise below what periods show, if that rise may hide an effect.

    At those low frequencies the noise is estimated from the residual. A slow effect that is not yet in the model (a
    drift) becomes part of the noise and is hidden by it: its evidence is limited to what the rise cost.
    """
    flat = replace(setting, whitener=setting.whitener.flat())
    if not setting.whitener.repeats or _rise(setting, flat) < 2.0 * SURE_LEAD:
        return None
    return in_noise(setting, flat.whitener, fit)


def _rise(setting: Setting, flat: Setting) -> float:
    """Return what the rise of the noise over a flat one costs, as twice the logarithm of the evidence."""
    return setting.log_variance - flat.log_variance


def _unmasked(flat: Setting, fit: Fit, found: Screen, price: float) -> Screen:
    """Return a screening against flat noise by the evidence that remains when the noise falls to the new residual.

    It falls no lower than where it is flat, and what lowers the misfit elsewhere needs no such screening.
    """
    rows, before = (float(np.sum(a)) for a in guessed_squares(flat, fit.residuals))
    gains = rows * -np.log1p(-np.minimum(found.drops / before, max(1.0 - rows / before, 0.0)))
    return replace(found, gains=np.asarray(gains, dtype=float), threshold=np.full(gains.size, price))


def _upheld(flat: Setting, trials: Sequence[Fit], best: Fit, price: float) -> list[Fit]:
    """Return those of `trials`, each under the noise of its residual, that are better than `best` there by `price`.

    A small reduction of the noise is significant under either's own noise, but not under the same.
    """
    upheld = []
    for trial in trials:
        own = reestimated(flat, trial)
        refitted, other = again(own, trial), again(own, best)
        if lead_of(own, refitted, other) > price:
            upheld.append(refitted)
    return upheld


def _colour(setting: Setting, fit: Fit) -> float:
    """Return the largest ratio of a residual's size to the part that its past does not predict."""
    ratios = [
        float(np.sqrt(np.mean(residual[record.fitted(), o] ** 2)) * setting.whitener.taps[o, 0])
        for record, residual in zip(setting.data.records, fit.residuals, strict=True)
        for o in setting.whitener.outputs
        if record.fitted().any()
    ]
    return max(ratios, default=0.0)


def _in_their_steps(
    setting: Setting, trials: list[Fit], before: Fit, price: float, rules: Rules
) -> tuple[Setting, list[Fit], Fit]:
    """Return what `_in_fine_steps` does; in the steps of the setting where the records show that they are theirs."""
    if rules.refined:
        careful = replace(setting, substeps=max(setting.substeps, rules.substeps))
        return _in_fine_steps(careful, trials, before, price)
    setting, trials, before = _iterated_gls(setting, trials, before, price)
    return *from_the_wave(setting, trials), before


def _in_fine_steps(setting: Setting, trials: list[Fit], before: Fit, price: float) -> tuple[Setting, list[Fit], Fit]:
    """Return `trials` and the fit `before` them, refitted, and the setting that goes with the best of them.

    The steps are as fine as the best one needs; it may need finer ones once it is fitted, and the noise beside it is
    known.
    """
    setting = replace(setting, substeps=steps_for(setting, trials))
    setting, trials, before = _iterated_gls(setting, trials, before, price)
    best = _best_of(setting, trials, before, price)
    finer = max(steps_for(setting, [best]), steps_in_noise(setting, best))
    if finer < _FINER * setting.substeps:
        return *from_the_wave(setting, trials), before
    setting = replace(setting, substeps=finer)
    return _in_fine_steps(setting, [_simulated(setting, f) for f in trials], before, price)


def _simulated(setting: Setting, fit: Fit) -> Fit:
    """Return a fit as it is simulated in the steps of `setting`: numbers that suit the error of coarser ones lose it.

    A noise that is not known is that which the fit leaves.
    """
    there = again(setting, fit, steps=0)
    return there if setting.whitener.repeats else again(reestimated(setting, there), there, steps=0)


def _iterated_gls(setting: Setting, trials: list[Fit], before: Fit, price: float) -> tuple[Setting, list[Fit], Fit]:
    """Return `trials` and the fit `before` them under the noise that they are compared in, and the best one's setting.

    Where periods repeat, all are compared under one noise, that of the best. Without repetition the noise is what a fit
    itself leaves, so each is iterated with its own.
    """
    if setting.whitener.repeats:
        for _ in range(_QUIETER):
            enough = score(in_units_of(setting, before), True) - price
            best = leading(trials, [score(f, True) for f in trials], enough)
            setting = reestimated(setting, best)
            trials = [again(setting, f) for f in trials]
            best = min(trials, key=lambda f: score(f, True))
            if best.misfit > _OVERRATED * best.rows:
                break
        return setting, trials, again(setting, before)
    own = [iterated_gls(setting, trials[0])]
    own += [iterated_gls(setting, f, score(own[0][1], False)) for f in trials[1:]]
    own.sort(key=lambda pair: score(pair[1], False))
    scores, enough = [score(f, False) for _, f in own], score(before, False) - price
    best = leading([f for _, f in own], scores, enough)
    own.sort(key=lambda pair: pair[1] is not best)
    # where noise and fit come to rest slowly, the rounds that decide are too few to answer
    own[0] = iterated_gls(*own[0])
    if _colour(*own[0]) > _DRIFTING:
        own[0] = min(own[0], from_white_noise(setting, own[0][1]), key=lambda pair: score(pair[1], False))
    return own[0][0], [fit for _, fit in own], before
