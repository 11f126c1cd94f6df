"""Iterated generalised least squares: the noise is estimated from the residual, and the fit is weighed by the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.fitting.fit import Fit, Setting, begun, left_by, linear_of, residuals_on
from analysis.diagnosis.fitting.modes import is_bent, moved_mode, narrow_modes, numbered
from analysis.diagnosis.fitting.refit import LONG, refit
from analysis.diagnosis.fitting.starts import Start, stack_white, starts_of, without_starts
from analysis.diagnosis.noise.estimate import even_weights, whitener_from
from analysis.diagnosis.noise.whitener import Whitener, louder
from analysis.diagnosis.nominal.tuning import turned
from analysis.diagnosis.records.dataset import Dataset, Record
from sim_backend.effects.base import Site
from sim_backend.linear import Array, ModalModel

_ROUNDS, _MOST, _IN_LINE = 6, 20, 10.0
"""Rounds of refit and noise at most, and so many while the numbers of effects still move; they end when another gains
less than this, in units of twice the evidence."""

_PASSES = 4

_SWEEPS = 2
"""How often each light mode is placed beside the others, where a descent from the nominal numbers distorted them."""


def reestimated(setting: Setting, fit: Fit, order: int | None = None) -> Setting:
    """Return the setting with noise, start bases and start states brought up to date with `fit`.

    `order` is the longest memory of the noise: none when it is white.
    """
    return reestimated_by(replace(setting, states=fit.states), linear_of(setting, fit), fit.residuals, order)


def reestimated_by(
    setting: Setting, linear: ModalModel, residuals: Sequence[Array], order: int | None = None
) -> Setting:
    """Return the setting updated with a linear model and its residual, (n, n_y) per record."""
    even = setting.whitener.even
    if even:
        whitener = even_weights(setting.data, residuals, even)
    else:
        # what a start adds is no noise: where it fades slowly, or never as a rigid body's, a filter that took it for
        # noise would differentiate, and nothing slow would count any more
        rest = without_starts(setting.data, linear, setting.whitener, residuals)
        whitener = louder(whitener_from(setting.data, list(rest), order=order), setting.added)
    setting = replace(setting, whitener=whitener, starts=starts_of(setting.data, linear, whitener))
    return replace(setting, states=begun(setting, setting.states, residuals))


def in_noise(setting: Setting, whitener: Whitener, fit: Fit) -> Setting:
    """Return the setting with another noise, and the start bases that go with it and `fit`."""
    return replace(setting, whitener=whitener, starts=starts_of(setting.data, linear_of(setting, fit), whitener))


def tune(setting: Setting) -> tuple[Setting, Fit]:
    """Return setting and fit of the adjusted nominal model, with the noise and the starts that go with it.

    Lightly damped modes that the data have elsewhere are moved there, one by one, where that is better; two that have
    changed places are exchanged.
    """
    best = _tuned(setting, np.zeros(len(setting.nuisances)))
    if is_bent(setting, best[1].change):
        best = min(best, _tuned(*_in_white_noise(setting, _placed(setting, best[1]))), key=lambda pair: _cost(*pair))
    for m in narrow_modes(setting):
        for change in moved_mode(*best, m):
            best = min(best, _tuned(*_in_white_noise(best[0], change)), key=lambda pair: _cost(*pair))
    change = numbered(setting.nominal, setting.nuisances, best[1].change)
    if change is not best[1].change:
        best = min(best, _tuned(best[0], change), key=lambda pair: _cost(*pair))
    if setting.whitener.repeats or setting.whitener.even:
        return best
    return min(best, iterated_gls(*best), from_white_noise(*best), key=lambda pair: _cost(*pair))


def tune_in_steps(setting: Setting) -> tuple[Setting, Fit]:
    """Return what `tune` does, in the steps per sample with which the stated effects explain the records.

    A bench that is simulated in steps of a sample holds torques that depend on the motion meanwhile. A model that has
    these torques, of such a bench or fitted in such steps, is wrong in finer ones: by far more than a sensor's noise
    where they are large. One step is taken where it is plainly better; what a real bench does shows no preference.
    """
    best = tune(setting)
    acting = any(effect.site in (Site.DRIVE, Site.STRUCTURE) for effect in setting.known)
    if not acting or setting.substeps == 1:
        return best
    coarse = replace(setting, substeps=1)
    if not np.isfinite(refit(coarse, (), np.zeros(0), best[1].change, steps=0).misfit):
        return best
    other = tune(coarse)
    return other if _cost(*other) < _cost(*best) - _IN_LINE else best


def from_white_noise(setting: Setting, fit: Fit) -> tuple[Setting, Fit]:
    """Return setting and fit after iterated generalised least squares that starts from white noise.

    Coloured noise can be consistent with a poor fit: it absorbs the slow part of the error. White noise cannot.
    """
    plain = reestimated(setting, fit, order=0)
    return iterated_gls(plain, again(plain, fit, steps=LONG))


def tuned_beside(setting: Setting, tuned: Fit, best: Fit) -> tuple[Setting, Fit] | None:
    """Return setting and fit of the nominal model tuned from the numbers of `best`, None where that is no better.

    Where nothing repeats, the noise is estimated from the residual, and the iteration may end in a wrong fixed point of
    both. An effect moves the parameters out of it; what these gain by themselves does not speak for it; it may
    have been dropped for that.
    """
    if setting.whitener.repeats or setting.whitener.even or np.array_equal(best.change, tuned.change):
        return None
    found = _tuned(setting, best.change)
    return found if score(found[1], False) < score(tuned, False) - _IN_LINE else None


def _placed(setting: Setting, bent: Fit) -> Array:
    """Return the change of the nuisances (n_nuisances,) with light modes where the data have them, all else nominal.

    Two light modes at wrong frequencies distort each other in a descent, and neither is then better anywhere else by
    itself. `bent` is the fit that such a descent ended in.
    """
    change = np.zeros(len(setting.nuisances))
    for m in narrow_modes(setting) * _SWEEPS:
        left = left_by(setting, turned(setting.nominal, setting.nuisances, change), ())
        found = moved_mode(setting, replace(bent, change=change, residuals=left), m)
        change = found[0] if found else change
    return change


def _in_white_noise(setting: Setting, change: Array) -> tuple[Setting, Array]:
    """Return the setting and the change of the nuisances (n_nuisances,) after a descent from there in white noise.

    Coloured noise has absorbed the mode's peak, so that moving the mode would gain nothing.
    """
    none = np.zeros(0)
    setting = replace(setting, begin=change)
    setting = reestimated(setting, refit(setting, (), none, change, steps=0), order=0)
    return setting, refit(setting, (), none, change).change


def _tuned(setting: Setting, change: Array) -> tuple[Setting, Fit]:
    none = np.zeros(0)
    setting = replace(setting, begin=change)
    fit = refit(setting, (), none, change)
    for _ in range(_PASSES):
        setting = reestimated(setting, fit)
        before = fit.objective
        fit = refit(setting, (), none, fit.change)
        if abs(before - fit.objective) < 1e-4 * fit.objective:
            break
    return setting, fit


def _cost(setting: Setting, fit: Fit) -> float:
    return score(fit, setting.whitener.repeats)


def plainly_better(setting: Setting, tuned: Fit) -> Fit:
    """Return `tuned`, or the nominal model where that simulates the fitted samples better, each from its best start.

    Both were fitted to the same samples: the given parameters to the readings, the adjusted ones to the readings
    whitened by noise of the residual's colour. Where the model lacks something at a resonance, that noise is resonant
    as well, and a fit that takes ringing for noise need not simulate the resonance.
    """
    change = np.zeros_like(tuned.change)
    given = _with_best_starts(setting, replace(tuned, change=change, change_std=np.zeros_like(tuned.change_std)))
    return given if _relative(setting, given) < _relative(setting, _with_best_starts(setting, tuned)) else tuned


def _with_best_starts(setting: Setting, fit: Fit) -> Fit:
    """Return a fit without effects with the start states that leave the least of the readings."""
    linear = turned(setting.nominal, setting.nuisances, fit.change)
    setting = reestimated_by(setting, linear, left_by(setting, linear, ()), order=0)
    return replace(fit, residuals=left_by(setting, linear, ()), states=setting.states)


def _relative(setting: Setting, fit: Fit) -> float:
    """Return the mean square of the fitted residuals, each output in units of its own on those samples."""
    rows = [record.fitted() for record in setting.data.records]
    y, left = (
        np.concatenate([values[used] for values, used in zip(whole, rows, strict=True)])
        for whole in ([record.y for record in setting.data.records], fit.residuals)
    )
    size = np.var(y, axis=0)
    return float(np.mean(np.mean(left**2, axis=0)[size > 0.0] / size[size > 0.0]))


def score(fit: Fit, known_noise: bool) -> float:
    """Return minus twice the logarithm of the evidence of a fit (Laplace's approximation), up to a constant.

    The price of a parameter is what the data narrowed it by: one that they do not determine costs nothing, and one
    that has to be far from where it is plausible pays for the distance in the fit's penalty. Where nothing repeats,
    colour and level of the noise are part of a hypothesis, and the likelihood is that of its innovations; where periods
    repeat, its levels at the lowest frequencies may be.
    """
    if known_noise:
        return float(fit.objective + fit.log_variance + 2.0 * fit.occam)
    level = fit.rows * (1.0 + np.log(max(fit.objective, 1e-300) / fit.rows))
    return float(level + fit.log_variance + 2.0 * fit.occam)


def gained(before: Fit, after: Fit, known_noise: bool) -> float:
    """Return twice the log-likelihood that a fit gains over the one `before`, each in its own noise or not."""
    return score(before, known_noise) - score(after, known_noise) + 2.0 * (after.occam - before.occam)


def iterated_gls(setting: Setting, fit: Fit, rival: float = np.inf) -> tuple[Setting, Fit]:
    """Return the setting and the fit in which the noise is the residual of the fit.

    The iteration of a fit that trails a `rival`'s score by more than the remaining rounds could gain ends early, once
    its parameters no longer change: a descent that still moves gains most in its last rounds.
    """
    best, left = (reestimated(setting, fit), fit), _ROUNDS
    for _ in range(_MOST):
        setting, before = reestimated(setting, fit), fit
        fit = again(setting, fit)
        gained = np.inf if best[1] is fit else score(best[1], False) - score(fit, False)
        if gained > 0.0:
            best = setting, fit
        if gained < _IN_LINE:
            break
        if _moving(before, fit):
            continue
        left -= 1
        if not left or score(best[1], False) - left * gained > rival:
            break
    return best


def _moving(before: Fit, fit: Fit) -> bool:
    """Tell whether a number of an effect has moved from one fit to the next by more than it is known to."""
    same = before.names == fit.names
    return same and bool(np.any(np.abs(fit.values - before.values) > fit.std))


def again(setting: Setting, fit: Fit, steps: int = 8, keep: Sequence[int] | None = None) -> Fit:
    """Return `fit` refitted in `setting`, whose noise or initial states may be new, in at most `steps` steps.

    With `keep`, only the effects of these numbers are kept.
    """
    candidates, sizes = fit.held(keep)
    return refit(setting, candidates, sizes, fit.change, steps=steps, exact=True, misled=fit.misled)


def sharpened(setting: Setting, fit: Fit) -> Fit:
    """Return `fit` at the least misfit over those parameters where it has cusps; unchanged without such parameters."""
    if not stepped(fit):
        return fit
    candidates, sizes = fit.held()
    return refit(setting, candidates, sizes, fit.change, steps=1, exact=True, sharp=True, misled=fit.misled)


def stepped(fit: Fit) -> bool:
    """Tell whether one of a fit's effects goes in steps, so that the misfit has cusps over its parameters."""
    return any(c.effect.whole or any(p.grain > 0.0 for p in c.effect.parameters()) for c in fit.candidates)


def guessed_squares(setting: Setting, residuals: Sequence[Array]) -> tuple[Array, Array]:
    """Return samples and sum of squares of residuals, (n, n_y) per record, in each output's each band of guessed noise.

    Both have the shape (n_y, guessed).
    """
    whitener = setting.whitener
    rows, squares = np.zeros((2, setting.data.n_outputs, whitener.guessed))
    for record, values, start in zip(setting.data.records, residuals, setting.starts, strict=True):
        white = _white_rows(setting, record, values, start)
        band = whitener.band_of_rows(record.fitted())
        for b in range(whitener.guessed):
            rows[:, b] += np.sum(band == b)
            squares[:, b] += np.sum(white[:, band == b] ** 2, axis=1)
    return rows, squares


def squares_of(setting: Setting, residuals: Sequence[Array]) -> Array:
    """Return the sums of squares (n_y,) of residuals, (n, n_y) per record, in units of the noise of `setting`."""

    def squares(record: Record, values: Array, start: Start) -> Array:
        return np.asarray(np.sum(_white_rows(setting, record, values, start) ** 2, axis=1))

    return np.sum(setting.each(squares, setting.data.records, residuals, setting.starts), axis=0)


def _white_rows(setting: Setting, record: Record, values: Array, start: Start) -> Array:
    """Return the fitted samples of `values` (n, n_y), whitened, the unknown start projected out: (n_y, rows)."""
    white = start.project(stack_white(setting.whitener, record, values[:, :, None])[:, 0])
    return np.asarray(white.reshape(values.shape[1], -1))


def left_however_tuned(data: Dataset, setting: Setting, fit: Fit, noise: Whitener) -> Sequence[Array]:
    """Return the residual (n, n_y) of every record of `data` in that noise, after `fit` saw all held-out samples.

    Parameters are known as well as the fitted samples determine them. On samples of another motion, their error may be
    many times the noise and follow the motion; it is not an error of the model as long as parameters exist that fit all
    samples.
    """
    told = tuple(replace(r, windows=tuple(replace(w, held_out=False) for w in r.windows)) for r in data.records)
    known = {id(r.y): state for r, state in zip(setting.data.records, setting.states, strict=True)}
    rest = np.zeros((setting.nominal.n_blocks, 2))
    setting = replace(
        setting,
        data=replace(data, records=told),
        whitener=noise,
        states=tuple(known.get(id(r.y), rest) for r in told),
        begin=fit.change,
    )
    setting = replace(setting, starts=starts_of(setting.data, linear_of(setting, fit), noise))
    return residuals_on(setting.data, setting, again(setting, fit))
