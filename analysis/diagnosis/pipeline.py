"""The diagnosis from data and model to verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from analysis.diagnosis.answer.sentence import reservation, sentence
from analysis.diagnosis.candidates.signature import Scales
from analysis.diagnosis.dominant import dominant_cause, judge_dominant, large_discrepancy, remainder, still_large
from analysis.diagnosis.evidence.as_given import error_as_given, left_as_given
from analysis.diagnosis.evidence.confirmed import confirmed
from analysis.diagnosis.evidence.domains import evidence
from analysis.diagnosis.evidence.gain import gain_of
from analysis.diagnosis.evidence.tuning_errors import tuning_errors
from analysis.diagnosis.experiment.next_experiment import choose
from analysis.diagnosis.experiment.reference_sensor import ReferenceRun, weigh_references
from analysis.diagnosis.fitting.balance import left_however_tuned, plainly_better, tune_in_steps, tuned_beside
from analysis.diagnosis.fitting.discrepancy import discrepancy_of
from analysis.diagnosis.fitting.fit import Fit, Setting, left_by, linear_of, residuals_on, steps_of
from analysis.diagnosis.fitting.starts import starts_of, without_starts, zeros_left
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.noise.whitener import Bands, Whitener, louder
from analysis.diagnosis.nominal.tuning import deviations, nuisances_of, own_nuisances_of, turned
from analysis.diagnosis.records.dataset import Dataset
from analysis.diagnosis.records.own_runs import fitted_delays, fitted_to, with_free_zeros
from analysis.diagnosis.result import Diagnosis, Domain, Gain
from analysis.diagnosis.search.adequacy import adequate
from analysis.diagnosis.search.exchange import exchangeable, exchanged
from analysis.diagnosis.search.rounds import Found, search
from analysis.diagnosis.search.shortlist import Rules
from analysis.diagnosis.search.stage import Progress, silent
from analysis.diagnosis.variance.causes import VarianceEffects, variance_effects
from analysis.diagnosis.variance.lines import without_lines, without_lines_of
from analysis.diagnosis.variance.quantisation import lattices_of
from analysis.diagnosis.verdict.causes import causes_of
from analysis.diagnosis.verdict.considered import considered_of
from analysis.diagnosis.verdict.drifting import drifts
from analysis.diagnosis.verdict.generic_alternative import generic_alternatives
from analysis.diagnosis.verdict.held_out import beside_doubts, follows_play, loses, validated
from analysis.diagnosis.verdict.judging import Judgement, failed_check, judge, shortfall
from analysis.diagnosis.verdict.lack_of_fit import LackOfFit, lacks_of_fit
from analysis.diagnosis.verdict.scatter import scatter_follows_play
from analysis.diagnosis.verdict.sensitivity import sensitivity_of
from analysis.diagnosis.verdict.unlisted_alternative import against_unlisted_alternatives
from campaigns.plans import Plan
from sim_backend.assembly import places_of, retuned, stated, transducers_of
from sim_backend.bench import Bench
from sim_backend.effects import INSIDE, library, named
from sim_backend.effects.base import Effect, Site
from sim_backend.errors import ConfigError, did_you_mean
from sim_backend.linear import Array, ModalModel
from sim_backend.model import Model

_COARSER = 8
"""First trials take steps so many times longer, but none longer than a sample."""

_SIDE_BY_SIDE = 100_000
"""Numbers from which on threads pay: of fewer, Python's part of the work takes a tenth longer with them and ends no
sooner."""

_MOST_SEARCHES = 3
"""Searches that are repeated, at most, because the one before led the nominal model to better numbers."""


@dataclass(frozen=True)
class Options:
    """How a diagnosis is done.

    `tolerance` is how far the nominal model's own numbers are trusted (relative standard deviation of each); numbers
    that were fitted to the same runs are adjusted freely, whatever it is.
    `without` leaves causes out of the search; `false_alarm` is the chance that any candidate passes the screening on
    noise alone. Raises ConfigError when an effect to leave out is unknown.
    """

    tolerance: float = 0.03
    without: tuple[str, ...] = ()
    false_alarm: float = 0.002
    max_effects: int = 3
    substeps: int = 4
    workers: int = 2
    seed: int = 0

    def __post_init__(self) -> None:
        reported = {name for e in named() for name in (e.reported(), e.name)}
        unknown = sorted(set(self.without) - reported)
        if unknown:
            near = did_you_mean(unknown[0], reported) or "`mccd model effects` lists them"
            raise ConfigError(f"there is no effect '{unknown[0]}' to leave out; {near.strip()}")


def searched_effects(options: Options, among: Sequence[type[Effect]] | None = None) -> tuple[type[Effect], ...]:
    """Return the effects that are not left out, `among` these or of the whole library."""
    return tuple(
        e for e in (library() if among is None else among) if not {e.reported(), e.name} & set(options.without)
    )


def search_causes(
    data: Dataset, model: Model, options: Options, progress: Progress = silent, added: tuple[Bands, ...] = ()
) -> Found:
    """Return everything the search finds, the noise being at least as strong as `added` say."""
    searched = searched_effects(options)
    linear, places = model.linear(), places_of(model)
    effects = stated(model.effects)
    linear = retuned(linear, effects, places)
    known = tuple(e for e in effects if e.site is not Site.MODEL)  # the linear model has those already
    runs = [record.name for record in data.records]
    own = fitted_to(model, runs)
    nuisances = own_nuisances_of(linear, fitted_delays(model, runs)) if own else nuisances_of(linear, options.tolerance)
    still = tuple(np.zeros((linear.n_blocks, 2)) for _ in data.records)
    fine = max(options.substeps, steps_of(linear, data.rate_hz))
    # effects that the model has already are there to stay: coarse steps would make an error of them
    first = fine if known else max(fine // _COARSER, 1)
    transducers = transducers_of(model)
    numbers = sum(record.y.size for record in data.records)
    workers = options.workers if numbers > _SIDE_BY_SIDE else 1
    residuals = left_as_given(model, data.records, data.rate_hz)
    rest = without_starts(data, linear, whitener_from(data, residuals), residuals)
    whitener = louder(whitener_from(data, list(rest)), added)
    starts = starts_of(data, linear, whitener)
    setting = Setting(
        data, linear, known, places, transducers, nuisances, whitener, starts, still, first, workers, added
    )
    inside = searched_effects(options, INSIDE)
    lattices = lattices_of(data, places.outputs)
    rules = Rules(searched, options.false_alarm, options.max_effects, fine, options.seed, inside, lattices)
    scales = scales_of(data, linear)
    if own and (large := large_discrepancy(setting)):
        found = dominant_cause(*large, rules, scales, progress)
        if still_large(found) or judge_dominant(found).verdict == "named":
            return found
    progress("tuning the nominal model", 0.0)
    setting, tuned = tune_in_steps(setting)
    first, rules = setting.substeps, replace(rules, refined=setting.substeps >= first)
    without_noise = partial(_without_band, searched)
    found = search(setting, tuned, rules, scales, progress, without_noise=without_noise)
    for _ in range(_MOST_SEARCHES):
        if (other := tuned_beside(replace(found.setting, substeps=first), found.tuned, found.best)) is None:
            break
        found = search(*other, rules, scales, progress, without_noise=without_noise)
    if suspects := _confounders(found):
        found = exchanged(found, suspects, rules, scales, progress)
    return against_unlisted_alternatives(found, scales, progress)


def _without_band(searched: Sequence[type[Effect]], setting: Setting, fit: Fit) -> Fit:
    """Return a fit without its vibration lines, where these are part of broadband noise that hides all else.

    Beside such a line, its neighbours in the band are significant one after the other.
    """
    if not setting.whitener.repeats:
        return fit
    rest = without_lines_of(setting, fit)
    if rest is fit or not variance_effects(setting, rest, searched, discrepancy_of(setting, rest, rest)).louder:
        return fit
    return rest


def _confounders(found: Found) -> list[int]:
    """Return the numbers of the effects of the best fit that may be confounders; none where it has too few or many.

    All may where they leave much; those that generic alternatives outdo, one by one, where no other check fails.
    """
    if not exchangeable(found):
        return []
    if not adequate(found):
        return list(range(len(found.best.candidates)))
    rivals = generic_alternatives(found.setting, found, together=False)
    outdone = [rival.gone[0] for rival in rivals if rival.ahead()]
    return [] if outdone and failed_check(found, lacks_of_fit(found.setting, found.best)) else outdone


def found_with_variance_effects(
    data: Dataset, model: Model, options: Options, progress: Progress
) -> tuple[Found, VarianceEffects]:
    """Return what the search finds, and the causes that show only in the noise.

    Where one of these makes noise louder, whatever was significant beside it has to be so again in that noise.
    """
    searched = searched_effects(options)
    found = without_lines(search_causes(data, model, options, progress))
    variance = variance_effects(found.setting, found.best, searched, found.discrepancy)
    stood_out = found.best.candidates or np.any(found.last.gains > found.last.threshold)
    if not (variance.louder and stood_out and found.setting.whitener.repeats):
        return found, variance
    found = without_lines(search_causes(data, model, options, progress, variance.louder))
    again = variance_effects(found.setting, found.best, searched, found.discrepancy)
    # what made the noise louder is there, whether or not it is significant once more
    same = {(type(c.effect), c.effect.where) for c in again.causes}
    kept = [replace(c, allowed=0.0) for c in variance.causes if c.louder is not None]
    more = tuple(c for c in kept if (type(c.effect), c.effect.where) not in same)
    return found, replace(again, causes=(*again.causes, *more))


def _confirmed(
    data: Dataset, options: Options, progress: Progress, found: Found, variance: VarianceEffects
) -> tuple[Found, VarianceEffects]:
    """Return what was found and held-out samples confirm, with the causes that show only in the noise beside that."""
    kept = confirmed(found, data)
    if kept is found:
        return found, variance
    kept = against_unlisted_alternatives(kept, scales_of(data, kept.setting.nominal), progress)
    return kept, variance_effects(kept.setting, kept.best, searched_effects(options), kept.discrepancy)


def scales_of(data: Dataset, linear: ModalModel) -> Scales:
    """Return the natural sizes of the data: rms of inputs and outputs, the first mode's time, ten kelvin."""
    lowest = np.min(linear.omega_rad_s[linear.omega_rad_s > 0.0], initial=np.inf)
    seconds = 1.0 / lowest if np.isfinite(lowest) else 10.0 / data.rate_hz
    u, y = data.u_scale(), data.y_scale()
    # a channel that never moves has no size of its own; any will do, because no signature passes through it
    return Scales(np.where(u > 0.0, u, 1.0), np.where(y > 0.0, y, 1.0), float(seconds), 10.0)


def diagnose(
    data: Dataset,
    model: Model,
    options: Options | None = None,
    progress: Progress = silent,
    bench: Bench | None = None,
    references: Sequence[ReferenceRun] = (),
    done: Sequence[Plan] = (),
) -> Diagnosis:
    """Return what `model` gets wrong about `data`, why, how sure that is, and what correcting it gains.

    The next experiment is one for `bench`, of which only the limits are read, or for the bench of `model`, and none
    that is `done`. `references` are what an instrument beside the bench saw; they decide between causes that readings
    cannot distinguish. Raises ConfigError when model and data do not fit together.
    """
    options = options or Options()
    data = with_free_zeros(data, model)
    searched = found_with_variance_effects(data.for_fitting(), model, options, progress)
    found, variance = _confirmed(data, options, progress, *searched)
    progress("weighing the evidence", 0.9)
    judgement, short = _judged(found, variance)
    found, judgement, remark = weigh_references(found, judgement, references, model, bench)
    judgement = variance.joined(judgement)
    setting, (tuned, best) = found.setting, _answered(found, judgement, model)
    answer = _answer(found, data, tuned, best, model, options.seed)
    floor = _noise_of_evidence(found, data, answer.before, answer.remaining)
    consistent = judgement.verdict == "consistent" and not setting.whitener.even
    left = left_however_tuned(data, setting, tuned, floor) if consistent else answer.before
    shown = evidence(data, left, floor, model, workers=setting.workers)
    judgement, unsteady = _checked(judgement, data, answer, shown, repeats=setting.whitener.repeats)
    if loses(answer.gain):  # what is worse than the model without it is not offered
        best = tuned
        answer = _answer(found, data, tuned, tuned, model, options.seed)
    gain, linear = answer.gain, turned(setting.nominal, setting.nuisances, best.change)
    choice = choose(found, judgement, model, bench, [*done, *(one.plan for one in references)])
    causes = (*causes_of(found.best, judgement, model), *variance.named(judgement, model))
    return Diagnosis(
        verdict=judgement.verdict,
        sentence=sentence(judgement.verdict, causes, judgement.tied, gain, shown, choice, judgement.remainder),
        causes=causes,
        ambiguous=judgement.tied,
        evidence=shown,
        gain=gain,
        next_experiment=choice.experiment if choice else None,
        data=data,
        nominal=model.linear(),
        linear=linear,
        effects=(*best.effects, *variance.effects),
        before=answer.before,
        after=answer.after,
        considered=considered_of(found, judgement),
        notes=_notes(found, judgement.failed_check, short, unsteady, remark, choice.reason if choice else ""),
        remainder=judgement.remainder,
        sensitivity=sensitivity_of(found, model),
        linear_std=deviations(linear, setting.nuisances, best.change_std * np.sqrt(judgement.inflation)),
        zeros=_zeros(setting, best),
        even=setting.whitener.even > 0.0,
        adjusted=turned(setting.nominal, setting.nuisances, tuned.change),
        tolerance=None if fitted_to(model, [record.name for record in data.records]) else options.tolerance,
    )


def _zeros(setting: Setting, fit: Fit) -> dict[int, tuple[float, float]]:
    """Return what a fit finds of the zeros that were free, by output: how far they are off, and its deviation."""
    data, whitener = setting.data, setting.whitener
    if not any(record.free_zeros for record in data.records):
        return {}
    left = left_by(setting, turned(setting.nominal, setting.nuisances, fit.change), fit.effects)
    return zeros_left(data, starts_of(data, linear_of(setting, fit), whitener), whitener, left)


@dataclass(frozen=True)
class _Answer:
    """What the model before and the one after leave of every record, the noise beside the latter, and the gain."""

    before: tuple[Array, ...]
    after: tuple[Array, ...]
    remaining: Whitener
    gain: Gain | None


def _answer(found: Found, data: Dataset, tuned: Fit, best: Fit, model: Model, seed: int) -> _Answer:
    setting = found.setting
    before = residuals_on(data, setting, tuned)
    after = before if best is tuned else residuals_on(data, setting, best)
    # without repeated periods the noise is known from residuals alone: from those of the best model, not of the first
    own = setting.whitener.repeats and not setting.added
    remaining = setting.whitener if own and not found.best.candidates else whitener_from(data, list(after))
    noise = setting.whitener if own else remaining
    first, last = (linear_of(setting, fit) for fit in (tuned, best))
    errors = {} if setting.whitener.even else tuning_errors(data, setting, best)
    names = [p.dof for p in model.outputs]
    gain = gain_of(data, before, after, noise, first, last, names, seed, errors)
    if gain is not None:
        moving = [one.output for one in gain.outputs]
        gain = replace(gain, rms_given=error_as_given(data, model, moving))
    return _Answer(before, after, remaining, gain)


def _checked(
    judgement: Judgement, data: Dataset, answer: _Answer, shown: Mapping[str, Sequence[Domain]], *, repeats: bool
) -> tuple[Judgement, str]:
    """Return the verdict that held-out samples and evidence leave of one, and in words what is not steady noise."""
    unsteady, played = reservation(judgement.verdict, shown), follows_play(shown)
    if growing := scatter_follows_play(data, answer.after):
        unsteady, played = growing, True
    judgement = validated(judgement, answer.gain, repeats, unsteady, played)
    return beside_doubts(judgement, data, answer.after), unsteady


def _judged(found: Found, variance: VarianceEffects) -> tuple[Judgement, str]:
    """Return the verdict on what the search found, and in words how far the best model gets where that is *unknown*."""
    if found.setting.whitener.even:
        return judge_dominant(found), ""
    random, louder = variance.share(found.best.rows), variance.beside(found.setting, found.best)
    left = sorted((*lacks_of_fit(louder, found.best), *drifts(louder, found.best)), key=LackOfFit.p_value)
    # there are many patterns: they are tested where one of them is the most significant part of the residual
    repeating = bool(left) and left[0].choices > 1
    judgement = judge(found, variance.allowed, left, random, generic_alternatives(louder, found, repeating=repeating))
    return judgement, shortfall(found, judgement, variance.allowed, random)


def _answered(found: Found, judgement: Judgement, model: Model) -> tuple[Fit, Fit]:
    """Return the nominal model and the best one as the answer has them."""
    whitener = found.setting.whitener
    if whitener.even:
        # an unlisted force cannot be written to a model file
        return found.tuned, found.tuned if judgement.verdict == "unknown" else found.best
    tuned = found.tuned
    # a noise that is known makes the tuned numbers the better ones
    if not whitener.repeats and fitted_to(model, [record.name for record in found.setting.data.records]):
        tuned = plainly_better(found.setting, tuned)
    return tuned, found.best if found.best.candidates else tuned


def _noise_of_evidence(found: Found, data: Dataset, before: Sequence[Array], remaining: Whitener) -> Whitener:
    """Return the noise above which the residual `before` is evidence.

    It is the `remaining` one, estimated from the residual of the best model: otherwise slow noise would absorb whatever
    is slow and explained.
    """
    if found.setting.whitener.even:
        return whitener_from(data, list(before))
    return remaining if found.best.candidates else found.setting.whitener


def _notes(found: Found, *said: str) -> tuple[str, ...]:
    """Return what was said in the course of a diagnosis and the doubts of its end, each once."""
    return tuple(filter(None, dict.fromkeys((*said, *_doubts(found)))))


def _doubts(found: Found) -> list[str]:
    """Return what a reader has to know about the noise and about the residual."""
    whitener = found.setting.whitener
    if whitener.even:
        return [remainder(found)]
    if whitener.repeats:
        return []
    return [
        "nothing repeats in these records, so the noise is estimated from the residual: slow forces and slow "
        "noise look alike, and an error of the model may be taken as noise"
    ]
