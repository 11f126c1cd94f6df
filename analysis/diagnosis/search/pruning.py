"""Which effects are needed: the evidence of each beside the others, and the best fit without those that are not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.fitting.balance import again, guessed_squares, iterated_gls, reestimated, score, sharpened
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.tails import chi2_limit, normal_tail
from sim_backend.effects.base import Site

_LOST = 1.0
"""A fit that is worse by so much (twice a logarithm) than another that it contains is in a wrong local minimum."""


SEEN = 3.0
"""Standard deviations from nothing at which an effect that has a name is at least."""


def lead_of(setting: Setting, fit: Fit, other: Fit) -> float:
    """Return by how much `fit` is better than `other`, as twice the logarithm of the evidence.

    Beside an earlier cause, slow noise that is estimated from n coefficients of the residual is known no better: a sum
    of squares S in its units has the likelihood of Student's t, twice its negative logarithm is 2n log(1 + S/n), and S
    only where the variance is certain. A residual below that estimate is not a merit. Noise does not fall towards low
    frequencies, so each band's is taken for no less than that of the bands above. A first cause has to lower the
    estimate itself, which noise seldom does.
    """
    known = setting.whitener.repeats
    lead = score(other, known) - score(fit, known)
    if not (known and other.candidates and setting.whitener.guessed and np.isfinite(lead)):
        return lead
    rows, own = guessed_squares(setting, fit.residuals)
    others = guessed_squares(setting, other.residuals)[1]
    n = np.maximum(rows, 1.0)
    levels = setting.whitener.levels[:, : setting.whitener.guessed]
    part = levels / np.maximum.accumulate(levels[:, ::-1], axis=1)[:, ::-1]
    told = 2.0 * n * np.log((n + np.maximum(part * others, n)) / (n + np.maximum(part * own, n)))
    return lead - float(np.sum(others - own - told))


def pruned(setting: Setting, best: Fit, tuned: Fit, price: float) -> tuple[Fit, list[Fit]]:
    """Return `best` without any effect that its score does not need by `price`, and the fits tried on the way.

    The last one too has to be worth its price at the end, as its noise and its steps are known by then. Where nothing
    repeats each fit has a noise of its own, that of the `tuned` nominal model among them, and an effect is kept only if
    it cannot be an effect of noise.
    """
    tried: list[Fit] = []
    known = setting.whitener.repeats
    nominal = again(setting, tuned) if best.candidates else tuned
    while best.candidates:
        numbers = range(len(best.candidates))
        unsure, single = [i for i in numbers if not is_seen(best, i)], len(numbers) == 1 and not known
        if unsure or not single:
            smaller = [alone(setting, best, nominal, [k for k in numbers if k != i]) for i in numbers]
            unsure = [i for i in unsure if not _seen_together(best, smaller[i], i)]
            tried += smaller
        if single and not unsure:
            if score(tuned, known) - score(best, known) > price:
                break
            best = tuned
            continue
        if unsure:  # its gain is that of the numbers adjusted beside it
            best = smaller[unsure[0]]
            continue
        least = min(smaller, key=lambda f: score(f, known))
        if not known:  # what the noise estimate gained is no merit of the effect
            tried.append(least := iterated_gls(setting, least)[1])
        if lead_of(setting, best, least) > price:
            break
        best = least
    return best, tried


def is_seen(fit: Fit, i: int) -> bool:
    """Tell whether a size of effect `i` is so far from nothing that noise does not take it there.

    An effect without sizes is there as a whole, or not at all.
    """
    sizes = {p.name for p in fit.effects[i].parameters() if p.size}
    own = [
        abs(value) >= SEEN * std
        for (effect, name), value, std in zip(fit.names, fit.values, fit.std, strict=True)
        if effect == i and name in sizes
    ]
    return any(own) or not own


def has_seen_model(fit: Fit) -> bool:
    """Tell whether every effect of a fit that changes the linear model itself is seen; see `is_seen`."""
    return all(effect.site is not Site.MODEL or is_seen(fit, i) for i, effect in enumerate(fit.effects))


def _seen_together(fit: Fit, without: Fit, i: int) -> bool:
    """Tell whether the numbers of effect `i`, none of whose sizes is significant by itself, are significant together.

    Sizes of one loop can replace each other, and a shape can replace a size: each is uncertain, and the loop is not.
    `without` is the fit that has all else adjusted instead. Adjusted parameters may also do what an effect on the
    linear model does, from another point, and nothing can replace a single size: it must be significant by itself
    there.
    """
    count = sum(effect == i for effect, _ in fit.names)
    chance = 2.0 * normal_tail(SEEN)
    gained = without.objective - fit.objective
    hidden = count > 1 and fit.effects[i].site is not Site.MODEL
    return hidden and gained > chi2_limit(chance, count)


def needed(setting: Setting, best: Fit) -> tuple[Setting, Fit]:
    """Return the setting with the noise estimated beside the pruned fit `best`, and that fit refined in this noise.

    The setting given has the noise estimated beside the causes before pruning. Where nothing repeats, noise and fit are
    iterated, as for every rival; where periods repeat, the noise is estimated again only if no cause remains.
    """
    if not setting.whitener.repeats:
        setting, best = iterated_gls(setting, best)
    elif not best.candidates:
        setting = reestimated(setting, best)
        best = again(setting, best)
    return setting, sharpened(setting, best)


def alone(setting: Setting, best: Fit, nominal: Fit, keep: Sequence[int]) -> Fit:
    """Return `best` refitted with those effects only that are numbered in `keep`.

    The nuisances are where the others moved them, and the fit may not lead back: whatever is worse than the
    `nominal` model, which it contains, starts from there once more.
    """
    fit = again(setting, best, keep=keep)
    if fit.objective < nominal.objective + _LOST:
        return fit
    candidates, sizes = best.held(keep)
    other = refit(setting, candidates, sizes, nominal.change, exact=True)
    return min(fit, other, key=lambda f: f.objective)
