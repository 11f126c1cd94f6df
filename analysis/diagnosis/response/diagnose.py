"""The diagnosis of a frequency-response table, from its points and a model to verdict, evidence and gain."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.answer.sentence import sentence
from analysis.diagnosis.nominal.tuning import deviations, nuisances_of, own_nuisances_of
from analysis.diagnosis.pipeline import Options, searched_effects
from analysis.diagnosis.records.dataset import Dataset
from analysis.diagnosis.records.own_runs import fitted_delays, fitted_to
from analysis.diagnosis.response.fits import Fit, Setting, fit, fit_nominal
from analysis.diagnosis.response.levels import compare_levels, depends_on_level, describe_levels
from analysis.diagnosis.response.lines import EVERY, Lines, Noise, noise_of
from analysis.diagnosis.response.search import Found, judged, of_levels, searched
from analysis.diagnosis.result import Diagnosis, Domain, Gain
from analysis.diagnosis.search.shortlist import SURE_LEAD
from analysis.diagnosis.search.stage import Progress, silent
from analysis.diagnosis.tails import chi2_tail, f_tail
from analysis.diagnosis.verdict.causes import causes_of
from analysis.diagnosis.verdict.judging import Judgement
from analysis.linear.predicted import Predictor, changes_the_response
from analysis.pages.quantities import span
from sim_backend.assembly import places_of, retuned, stated
from sim_backend.effects import effect_class
from sim_backend.effects.base import Site
from sim_backend.effects.words import effect_text
from sim_backend.linear import ComplexArray
from sim_backend.model import Model

Mask = NDArray[np.bool_]

BANDS = 40

DRAWS = 2000


@dataclass(frozen=True)
class Responses:
    """What a page draws: all points with their noise, and the responses (n,) of the nominal and the extended model."""

    lines: Lines
    noise: Noise
    nominal: ComplexArray
    extended: ComplexArray


def diagnose_response(
    lines: Lines,
    model: Model,
    path: Path,
    options: Options | None = None,
    *,
    held: bool = False,
    progress: Progress = silent,
) -> tuple[Diagnosis, Responses]:
    """Return what `model` gets wrong about measured points, why, what correcting it gains, and what is drawn of it.

    `held` says that the table was measured from samples to samples behind a hold at the model's rate; by default it is
    a response of continuous signals. `progress` is called with each stage.
    """
    options = options or Options()
    setting = _setting(lines, model, path, options, held=held)
    tuned = fit_nominal(_only(setting, ~setting.lines.held_out))
    setting = _heard(setting, tuned)
    levels = compare_levels(setting, setting.modelled(tuned.linear, ()), model, path.name)
    if depends_on_level(levels):
        words = describe_levels(_only(setting, ~lines.held_out), model)
        first = _only(setting, _lowest(lines))
        found = searched(_only(_heard(first, tuned), ~first.lines.held_out), (), 0, progress)
        judgement = of_levels(words)
    else:
        setting, found = _searched(setting, options, progress)
        judgement = judged(_only(setting, ~lines.held_out), found)
    notes = _notes(setting, judgement, model, found, levels)
    return _answer(setting, model, path, found, judgement, levels, notes, options)


def _setting(lines: Lines, model: Model, path: Path, options: Options, *, held: bool) -> Setting:
    """Return all points with the noise about the model as it is given."""
    places = places_of(model)
    known = stated(e for e in model.effects if changes_the_response(effect_class(e.effect)))
    linear = retuned(model.linear(), known, places)
    table = [path.name]
    late = fitted_delays(model, table)
    nuisances = own_nuisances_of(linear, late) if fitted_to(model, table) else nuisances_of(linear, options.tolerance)
    hold = model.sample_rate_hz if held else None
    rest = tuple(e for e in known if e.site is not Site.MODEL)
    setting = Setting(
        lines,
        Noise(np.ones((lines.n, 2)), np.inf, ""),
        linear,
        rest,
        nuisances,
        Predictor(places, lines.frequency_hz, hold),
    )
    return replace(setting, noise=noise_of(lines, setting.modelled(linear, ())))


def _only(setting: Setting, keep: Mask) -> Setting:
    noise = replace(setting.noise, sigma=setting.noise.sigma[keep])
    return replace(setting, lines=setting.lines.only(keep), noise=noise)


def _heard(setting: Setting, found: Fit) -> Setting:
    """Return the setting with the noise about what a fit has found."""
    return replace(setting, noise=noise_of(setting.lines, setting.modelled(found.linear, found.effects)))


def _lowest(lines: Lines) -> Mask:
    """Return which points (n,) are of the lowest level of their entry."""
    entry = lines.output * (lines.input.max() + 1) + lines.input
    lowest = {e: np.nanmin(lines.level[entry == e]) for e in np.unique(entry)}
    return np.array([lines.level[k] == lowest[entry[k]] for k in range(lines.n)])


def _searched(setting: Setting, options: Options, progress: Progress) -> tuple[Setting, Found]:
    """Return what a search finds; noise that is estimated from the residual is that of the first search."""
    effects = searched_effects(options)
    found = searched(_only(setting, ~setting.lines.held_out), effects, options.max_effects, progress)
    if found.best.candidates and not np.isinf(setting.noise.dof):
        setting = _heard(setting, found.best)
        found = searched(_only(setting, ~setting.lines.held_out), effects, options.max_effects, progress)
    return setting, found


def _answer(
    setting: Setting,
    model: Model,
    path: Path,
    found: Found,
    judgement: Judgement,
    levels: tuple[Domain, ...],
    notes: tuple[str, ...],
    options: Options,
) -> tuple[Diagnosis, Responses]:
    best, lines = found.best, setting.lines
    both = [setting.modelled(one.linear, one.effects) for one in (found.tuned, best)]
    drawn = Responses(lines, setting.noise, both[0], both[1])
    evidence = {"frequency": by_frequency(lines, setting.noise, both[0], model, path.name)}
    if levels:
        evidence["level"] = levels
    dependent = depends_on_level(levels)
    gain = None if dependent else gain_of(lines, setting.noise, both[0], both[1], path.name, options.seed)
    causes, n = causes_of(best, judgement, model), len(setting.nuisances)
    std = np.sqrt(np.maximum(np.diag(setting.turn @ best.covariance[:n, :n] @ setting.turn.T), 0.0))
    said = sentence(judgement.verdict, causes, judgement.tied, gain, evidence)
    diagnosis = Diagnosis(
        verdict=judgement.verdict,
        sentence=f"The simulation is wrong: {judgement.failed_check}." if dependent else said,
        causes=causes,
        ambiguous=judgement.tied,
        evidence=evidence,
        gain=gain,
        next_experiment=None,
        data=Dataset(model.sample_rate_hz, ()),
        nominal=model.linear(),
        linear=best.linear,
        effects=best.effects,
        before=(),
        after=(),
        considered=judgement.rivals,
        notes=notes,
        linear_std=deviations(best.linear, setting.nuisances, std),
        adjusted=found.tuned.linear,
        tolerance=None if fitted_to(model, [path.name]) else options.tolerance,
    )
    return diagnosis, drawn


def _notes(
    setting: Setting, judgement: Judgement, model: Model, found: Found, levels: tuple[Domain, ...]
) -> tuple[str, ...]:
    """Return what a reader has to know of the table, the noise and the verdict."""
    nonlinear = [effect_text(e.effect) for e in model.effects if not changes_the_response(effect_class(e.effect))]
    notes = [
        *setting.lines.remarks,
        judgement.failed_check if not depends_on_level(levels) else "",
        f"the noise is known from: {setting.noise.source}",
        _hold_remark(setting, model, found) if judgement.verdict != "consistent" else "",
    ]
    if not levels:
        notes.append("one level of excitation: whether anything nonlinear acts cannot be seen")
    if nonlinear:
        notes.append(f"effects of the model that no response at one level shows are left out: {', '.join(nonlinear)}")
    return tuple(filter(None, notes))


def _hold_remark(setting: Setting, model: Model, found: Found) -> str:
    """Return a remark where the nominal model behind a hold explains the table, though it is taken for continuous."""
    rate_hz = model.sample_rate_hz
    if setting.predictor.hold_rate_hz or setting.lines.frequency_hz.max() > 0.5 * rate_hz:
        return ""
    lines = _only(replace(setting, predictor=replace(setting.predictor, hold_rate_hz=rate_hz)), ~setting.lines.held_out)
    behind = fit(lines)
    # better than nothing is not enough: half a sample of delay is part of any longer one
    if behind is None or behind.evidence < max(found.tuned.evidence, found.best.evidence - 2.0 * SURE_LEAD) + SURE_LEAD:
        return ""
    return (
        f"behind a hold at the model's rate of {rate_hz:g} Hz the nominal model explains the table by itself: if it "
        "was measured from commands to readings of that rate, say so with --held"
    )


def by_frequency(lines: Lines, noise: Noise, modelled: ComplexArray, model: Model, record: str) -> tuple[Domain, ...]:
    """Return, per curve, the residual of a model's response (n,) in bands of neighbouring points, in units of noise."""
    turned = (lines.response - modelled) * np.exp(-1j * np.angle(lines.response))
    square = 0.5 * ((turned.real / noise.sigma[:, 0]) ** 2 + (turned.imag / noise.sigma[:, 1]) ** 2)
    found = []
    for curve in np.unique(lines.curve):
        rows = np.flatnonzero(lines.curve == curve)
        parts = np.array_split(rows, min(BANDS, rows.size))
        level = np.sqrt([square[part].mean() for part in parts])
        axis = np.array([np.exp(np.log(lines.frequency_hz[part]).mean()) for part in parts])
        total, dof = float(square[rows].mean()), 2 * rows.size
        p = chi2_tail(total * dof, dof) if np.isinf(noise.dof) else f_tail(total, dof, noise.dof)
        worst = parts[int(np.argmax(level))]
        place = span(lines.frequency_hz[worst[0]], lines.frequency_hz[worst[-1]], "Hz")
        name = model.outputs[int(lines.output[rows[0]])].dof
        at = "" if np.isnan(lines.level[rows[0]]) else f" at level {lines.level[rows[0]]:g}"
        where = f"{name} at {place}{at}: {level.max():.3g} times the noise"
        found.append(Domain(record, name, axis, "Hz", level, np.ones(level.size), float(p), where))
    return tuple(found)


def gain_of(
    lines: Lines, noise: Noise, before: ComplexArray, after: ComplexArray, record: str, seed: int
) -> Gain | None:
    """Return what the extension gains on held-out points: rms of their relative errors; None without any.

    `before` and `after` are the modelled response (n,) at each point. The error is that of the output over the output
    under an excitation that makes every point of it as strong. The interval is a bootstrap over blocks of neighbouring
    points.
    """
    held = lines.held_out
    if not held.any():
        return None
    size2 = np.abs(lines.response[held]) ** 2
    errors = [np.abs(lines.response - modelled)[held] ** 2 / size2 for modelled in (before, after)]
    first, last = (float(np.sqrt(e.mean())) for e in errors)
    rows = np.flatnonzero(held)
    block = np.cumsum(np.diff(rows, prepend=rows[0]) > 1)
    sums = [np.bincount(block, e) for e in errors]
    drawn = np.random.default_rng(seed).integers(0, sums[0].size, (DRAWS, sums[0].size))
    ratio = np.sqrt(sums[1][drawn].sum(axis=1) / np.maximum(sums[0][drawn].sum(axis=1), np.finfo(float).tiny))
    low, high = np.quantile(1.0 - ratio, [0.025, 0.975])
    # noise that is known from other points may seem larger than the error that it is part of
    floor = min(float(np.sqrt(np.mean(np.sum(noise.sigma[held] ** 2, axis=1) / size2))), first, last)
    return Gain(
        held_out=(f"{record}#one of {EVERY} blocks of neighbouring points, {int(held.sum())} of {lines.n} points",),
        rms_before=first,
        rms_after=last,
        noise_floor=floor,
        reduction=1.0 - last / first if first > 0.0 else 0.0,
        ci95=(float(low), float(high)),
    )
