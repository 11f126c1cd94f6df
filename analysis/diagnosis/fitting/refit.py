"""Refit in full simulation: nominal and effect parameters together, by descent on whitened residuals.

Screening is right to first order; here the effect acts inside the loop, so large effects, several at once and shapes
that screening held fixed all come out unbiased.

A fit descends along slopes that are cheap first. One that others are compared with (`exact`) goes on along differences
of full simulations: where two nuisances nearly do the same, the valley they span must be known to far better than the
size of the effect, or no step along it can be taken.

Axes that have nothing to do with each other are fitted one by one, and those to which a hypothesis adds nothing only
once under one noise.

An effect on the model takes over what the nuisances did in its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
import scipy

from analysis.diagnosis.candidates.parameters import parameters_of
from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.parts import Part, parts_of, setting_of, whole_of
from analysis.diagnosis.fitting.problem import Problem, together
from analysis.diagnosis.fitting.slopes import Slopes
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.nominal.responses import stacked
from analysis.diagnosis.nominal.tuning import change_to, mahalanobis2_of, turned, turning
from analysis.diagnosis.side_by_side import side_by_side
from sim_backend.assembly import retuned
from sim_backend.effects.base import Effect
from sim_backend.errors import ConfigError
from sim_backend.linear import Array, ModalModel

LONG = 25
"""Steps of a fit that begins far from where it ends."""


@dataclass(frozen=True)
class _Manner:
    """How a fit is done; see `refit`."""

    steps: int
    exact: bool
    strong: bool = False
    sharp: bool = False
    misled: bool = False


def refit(
    setting: Setting,
    candidates: Sequence[Candidate],
    sizes: Array,
    change: Array,
    *,
    steps: int = LONG,
    exact: bool = False,
    strong: bool = False,
    sharp: bool = False,
    misled: bool = False,
) -> Fit:
    """Return the best fit of a hypothesis from screened `sizes` and nuisances' `change`; without candidates, of these.

    `sizes` (k,) are in units of each candidate's columns, joined; `change` is (n_nuisances,). A hypothesis that cannot
    be simulated ends with an infinite misfit. Standard deviations are right only of an `exact` fit. Beside a `strong`
    effect, one that changes the whole motion, slopes with torques held lead astray: differences of full simulations are
    taken from the start; the screened start goes too far there, and is shortened until it is better than nothing.
    Parameters over which the misfit has a cusp stay where a descent ends, unless the fit is to be `sharp`. Slopes that
    have `misled` the fit before this one are not tried again.
    """
    manner = _Manner(steps, exact, strong, sharp, misled)
    setting = _with_own_starts(setting, candidates, sizes, change)
    parts = in_parts(setting, candidates, sizes)
    if len(parts) == 1:
        return _whole(setting, candidates, sizes, change, manner)
    each = sizes_of_each(candidates, sizes)
    fits = []
    for part, own in parts:
        chosen = [candidates[i] for i in part.candidates]
        if chosen:
            begins = np.concatenate([each[i] for i in part.candidates])
            fits.append(_whole(own, chosen, begins, change[part.nuisances], manner))
        else:
            fits.append(_quiet(setting, part, own, exact))
    return _joined(setting, candidates, [part for part, _ in parts], fits)


def _with_own_starts(setting: Setting, candidates: Sequence[Candidate], sizes: Array, change: Array) -> Setting:
    """Return the setting with the starts of modes that a hypothesis has, without those that another one adds.

    Such a mode may begin to ring at any size, whatever drives it: a hypothesis without it would have that for nothing.
    """
    known = setting.starts[0].back.shape[0] // 2
    if known == setting.nominal.n_blocks:
        return setting
    problem, start = Problem.of(setting, candidates, sizes)
    linear = turned(setting.nominal, setting.nuisances, change)
    with suppress(ConfigError):  # an effect that cannot be keeps all starts: it has no fit
        linear = retuned(linear, problem.effects(np.concatenate([change, start])), setting.places)
        if known > linear.n_blocks:
            states = tuple(state[: setting.nominal.n_blocks] for state in setting.states)
            return replace(setting, starts=starts_of(setting.data, linear, setting.whitener), states=states)
    return setting


def in_parts(setting: Setting, candidates: Sequence[Candidate], sizes: Array) -> list[tuple[Part, Setting]]:
    """Return the parts of a hypothesis, each with its setting: itself where it does not fall apart; see `refit`."""
    whole, found = [(whole_of(setting, candidates), setting)], []
    problem, start = Problem.of(setting, candidates, sizes)
    try:
        parts = parts_of(
            setting, candidates, problem.effects(np.concatenate([np.zeros(len(setting.nuisances)), start]))
        )
    except ConfigError:  # screening asked for what cannot be: the fit begins elsewhere
        return whole
    for part in parts:
        key = ("setting", tuple(part.outputs), tuple(part.modes))
        own = setting.once.of(key, partial(setting_of, setting, part))
        if own is None:
            return whole
        found.append((part, own))
    return found or whole


def sizes_of_each(candidates: Sequence[Candidate], sizes: Array) -> list[Array]:
    """Return the `sizes` (k,) of every candidate by itself; one without sizes counts as one whole."""
    ends = np.cumsum([max(len(c.unit_sizes), 1) for c in candidates], dtype=np.int64)
    return np.split(sizes, ends[:-1])


def _quiet(setting: Setting, part: Part, own: Setting, exact: bool) -> Fit:
    """Return the fit of a part to which nothing is added, which is the same in every hypothesis."""
    manner = _Manner(LONG, exact)
    # from where every hypothesis would have it begin: the first to ask must not decide on the last digits
    key = ("fit", tuple(part.outputs), tuple(part.modes), exact)
    begin = np.zeros(len(own.nuisances)) if own.begin is None else own.begin
    return setting.once.of(key, lambda: _whole(own, (), np.zeros(0), begin, manner))


def _whole(setting: Setting, candidates: Sequence[Candidate], sizes: Array, change: Array, manner: _Manner) -> Fit:
    """Return the best fit of a hypothesis that is taken as one."""
    problem, start = Problem.of(setting, candidates, sizes)
    n_nuisances = len(setting.nuisances)
    x = np.concatenate([change, start])
    if not np.isfinite(problem.evaluate(x).misfit):
        # screening asked for what cannot be: begin where the effect adds nothing
        x[n_nuisances:] = [0.0 if scale.size else value for scale, value in zip(problem.scales, start, strict=True)]
    elif manner.strong:
        x = problem.shortened(x)
    slopes = Slopes(problem, strong=manner.strong, misled=manner.misled)
    x, found = problem.descend(slopes, x, manner.steps, exact=manner.exact)
    deviations: dict[int, float] = {}
    if manner.sharp and np.isfinite(found.misfit):
        x, found, deviations = problem.at_cusps(slopes, x, found)
    fit = problem.finish(x, found, slopes.latest(x, found), deviations)
    return replace(fit, misled=slopes.misled)


def _joined(setting: Setting, candidates: Sequence[Candidate], parts: Sequence[Part], fits: Sequence[Fit]) -> Fit:
    """Return the fit of a whole from those of its parts."""
    change, change_std = np.zeros((2, len(setting.nuisances)))
    residuals = tuple(np.empty_like(record.y) for record in setting.data.records)
    effects: dict[int, Effect] = {}
    found: dict[tuple[int, str], tuple[float, float]] = {}
    rows = sum(fit.rows for fit in fits)
    occam = 0.0
    for part, fit in zip(parts, fits, strict=True):
        change[part.nuisances], change_std[part.nuisances] = fit.change, fit.change_std
        effects |= dict(zip(part.candidates, fit.effects, strict=True))
        for whole, own in zip(residuals, fit.residuals, strict=True):
            whole[:, part.outputs] = own
        for (i, name), value, std in zip(fit.names, fit.values, fit.std, strict=True):
            found[part.candidates[i], name] = float(value), float(std)
        occam += fit.occam
    names = sorted(found, key=lambda key: key[0])
    return replace(
        fits[0],
        candidates=tuple(candidates),
        change=change,
        effects=tuple(effects[i] for i in range(len(candidates))),
        misfit=sum(fit.misfit for fit in fits),
        penalty=sum(fit.penalty for fit in fits),
        rows=rows,
        occam=occam,
        log_variance=setting.log_variance,
        names=tuple(names),
        values=np.array([found[name][0] for name in names]),
        std=np.array([found[name][1] for name in names]),
        residuals=residuals,
        states=setting.states,
        change_std=change_std,
        misled=any(fit.misled for fit in fits),
    )


def exact_sensitivities(setting: Setting, fit: Fit) -> tuple[Array, ...]:
    """Return, per record, the outputs' change per unit of each nuisance and each effect parameter, (n, n_y, k).

    By differences of the full simulation: what is screened beside these columns is compared with noise, and an error of
    a thousandth in a nuisance's column can be far above it.
    """
    held, sizes = fit.held()
    if not (held or setting.known):
        return plain_sensitivities(setting, turned(setting.nominal, setting.nuisances, fit.change))
    scales, _ = parameters_of(held, sizes)
    n_nuisances = len(setting.nuisances)
    out = tuple(np.zeros((n_nuisances + len(scales), *r.y.shape[::-1])).T for r in setting.data.records)
    each = sizes_of_each(held, sizes)
    for part, own in in_parts(setting, held, sizes):
        chosen = [held[i] for i in part.candidates]
        begins = np.concatenate([np.zeros(0), *(each[i] for i in part.candidates)])
        columns = [*part.nuisances, *(n_nuisances + k for k, s in enumerate(scales) if s.effect in part.candidates)]
        for record, found in zip(out, _exact(own, chosen, begins, fit.change[part.nuisances]), strict=True):
            record[:, part.outputs[:, None], columns] = found
    return out


def _exact(setting: Setting, held: Sequence[Candidate], sizes: Array, change: Array) -> list[Array]:
    """Return, per record, the columns of nuisances and effect parameters of what is taken as one, (n, n_y, k)."""
    problem, start = Problem.of(setting, held, sizes)
    x = np.concatenate([change, start])
    here, _ = problem.raw(x)  # the starts may have been found anew since the fit

    def fixed(i: int) -> bool:
        # the slope by a step of rounding is that of a gain as long as no number is rounded otherwise: beside it a gain
        # would go anywhere
        return i >= change.size and held[problem.scales[i - change.size].effect].effect.whole

    columns = [[np.zeros_like(r) for r in here] for _ in range(x.size)]
    groups = together([i for i in range(x.size) if not fixed(i)])
    alone = replace(problem, setting=replace(setting, workers=1))
    slopes = side_by_side(lambda several: alone.slopes(x, several, here), groups, workers=setting.workers)
    for several, found in zip(groups, slopes, strict=True):
        for i, slope in zip(several, found, strict=True):
            if slope is not None:
                columns[i] = [-own for own in slope]
    empty = [np.zeros((*r.shape, 0)) for r in here]
    return [stacked([c[r] for c in columns]) if columns else empty[r] for r in range(len(here))]


def plain_sensitivities(setting: Setting, linear: ModalModel) -> tuple[Array, ...]:
    """Return, per record, the change of the outputs of `linear` by itself per unit of each nuisance, (n, n_y, k)."""
    turn = turning(linear, setting.nuisances, setting.data.rate_hz)
    return tuple(
        turn.columns(record.u, states) for record, states in zip(setting.data.records, setting.states, strict=True)
    )


def taken_over(setting: Setting, fit: Fit, candidate: Candidate, sizes: Array) -> tuple[Array, bool]:
    """Return the nuisances when an effect on the model does what they did, and whether nothing else changes.

    The nuisances are (n_nuisances,), `sizes` (k,) in units of the candidate's columns. Raises ConfigError where there
    is no such effect.
    """
    linear, units = turned(setting.nominal, setting.nuisances, fit.change), candidate.unit_sizes
    effect = candidate.made(dict(zip(units, sizes * np.array(list(units.values())), strict=True)))
    start = fit.change - change_to(linear, setting.nuisances, retuned(linear, [effect], setting.places))
    made = retuned(turned(setting.nominal, setting.nuisances, start), [effect], setting.places)
    same = made.n_blocks == linear.n_blocks and all(
        np.allclose(getattr(made, f.name), getattr(linear, f.name), rtol=1e-9, atol=0.0) for f in fields(linear)
    )
    return start, same


def part_to_take(setting: Setting, fit: Fit, candidate: Candidate, sizes: Array) -> float:
    """Return the part of its screened `sizes` (k,) that an effect begins with.

    Where nuisances and effect can share in any proportion and the data see no difference, the nominal model decides:
    the part that leaves the nuisances least to do. A descent would have to find it along a narrow, bent valley.
    """
    if not taken_over(setting, fit, candidate, sizes)[1]:
        return 1.0

    def left(part: float) -> float:
        with suppress(ConfigError):
            return mahalanobis2_of(setting.nuisances, taken_over(setting, fit, candidate, part * sizes)[0])
        return np.inf

    found = scipy.optimize.minimize_scalar(left, bounds=(0.0, 2.0), method="bounded")
    return float(found.x) if found.fun < left(1.0) else 1.0
