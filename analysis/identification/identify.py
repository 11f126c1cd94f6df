"""From recorded runs to a linear model file, by the method that fits how they were excited.

- *stepped sine*: sine fits of the steady state, one axis per run, and a rational fit of each axis;
- *periodic*: the response of all inputs at once, with noise and distortion separated, and a rational fit of it;
- *free*: anything else, a prediction-error fit in time with the start of every segment estimated; of an axis that
  drifts and has friction, the balance of its torques.

Segments with "held-out" in their label take no part; the model is tried on them afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import msgspec
import numpy as np
from numpy.typing import NDArray

from analysis.identification.axes import Axes, fit_axes
from analysis.identification.between_samples import response_freed
from analysis.identification.determined import without_undetermined
from analysis.identification.from_sweeps import identify_sweeps
from analysis.identification.growing_poles import curves_in_a_loop, remarks_on_growth
from analysis.identification.held_out import channels_of, tried
from analysis.identification.identified import Fitted, HeldOut, Identification, fitted_by, identification
from analysis.identification.in_time import fit_in_time, fitted_again, in_a_loop, may_be_late
from analysis.identification.line_fit import fit_lines, pooled_variance
from analysis.identification.merged_pairs import with_pairs_merged
from analysis.identification.missed_response import remarks_on_misses, response_of_model
from analysis.identification.modal_parameters import Structure
from analysis.identification.realisations import Realisations, bring_to_one_level, noise_power, realisations_of
from analysis.identification.record_remarks import inputs_at_rest, is_stepped_sine, remarks_on_records, untold
from analysis.identification.refined import refined
from analysis.identification.response_curves import curves_of_periods
from analysis.identification.response_fit import RationalFit
from analysis.identification.swing import settled_response
from analysis.identification.taking_part import Parts, taking_part, with_all_channels
from analysis.identification.timefit import TimeFit
from analysis.identification.whole_delay import BEGINNING_ROWS, beginning
from analysis.recorded.folded import averaged_response, too_long
from campaigns.facts import facts_of, measured_segments
from campaigns.facts.loop import NAME as LOOP
from campaigns.log import Run
from campaigns.progress import Report, part_of, unheard
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import ModalModel
from sim_backend.model import EffectEntry, Port, Quantity

Array = NDArray[np.float64]
Tell = Callable[[str], None]

ROLES = ("input", "output")

ORDERS = (1, 2, 3, 4, 5, 6)
"""Numbers of modes to choose from when none is given, for each input."""

MANY_ROWS = 50_000
"""Samples of a segment above which the number of modes is not chosen in time: each takes minutes, and nonlinear
distortion leads to more of them."""


def identify_runs(
    runs: Sequence[Run],
    *,
    modes: int | Sequence[int] | None = None,
    only: str = "",
    equal_weights: bool = False,
    name: str = "identified",
    report: Report = unheard,
    tell: Tell = untold,
) -> Identification:
    """Return the linear model that explains `runs` best; all must have the same inputs and outputs, or be sweeps.

    `modes` is the number of modes or several to choose from (per axis for sweeps); `only` fits the segments whose
    label contains it. `equal_weights` fits periodic data for the least rms error instead of weighing each line by its
    noise: better when the misfit is nonlinear distortion, not noise. `tell` hears the remarks on the records before
    anything is fitted. Raises DataError for runs that differ or hold nothing to fit, ConfigError for `only` and
    `equal_weights` with stepped sines, which are fitted whole, each axis by its own noise.
    """
    orders = _orders(runs, modes)
    if not runs:
        raise DataError("identify: no run is given; give one log at least")
    if all(is_stepped_sine(run) for run in runs):
        _require_whole(only, equal_weights)
        return identify_sweeps(runs, orders, name, report, tell)
    _require_same_channels(runs)
    still = inputs_at_rest(runs)
    parts = [(run, s) for run in runs for s in measured_segments(run)]
    fitting = [(run, s) for run, s in parts if s.rows and only in s.label and not s.held_out]
    if not fitting:
        raise DataError(
            f"{runs[0].path}: no segment remains to fit; give segments that are not held-out, match --only, move, and "
            f"are not cut off by their sensor every few samples{_missing(runs)}"
        )
    told = (*still, *remarks_on_records(runs))
    for remark in told:
        tell(remark)
    # what is averaged over periods is a ratio of two that hold the same noise, where inputs answer the outputs
    periodic = None if _in_a_known_loop(fitting) else realisations_of(fitting)
    if periodic is not None:
        found = _from_periods(periodic, parts, orders, name, equal_weights, report)
    else:
        found = _of_what_takes_part(fitting, parts, modes, name, equal_weights, report, tell)
    missed = remarks_on_misses(found.response, response_of_model(found.model))
    measured = found.response or tuple(curves_in_a_loop(fitting))
    grows = remarks_on_growth(found.model, measured)
    return replace(found, remarks=(*told, *grows, *found.remarks, *missed))


def _require_whole(only: str, equal_weights: bool) -> None:
    for given, what in ((only, "--only (only)"), (equal_weights, "--equal-weights (equal_weights)")):
        if given:
            raise ConfigError(f"{what} has no effect on stepped sines, which are fitted whole; leave it out")


def _of_what_takes_part(
    fitting: Parts,
    parts: Parts,
    modes: int | Sequence[int] | None,
    name: str,
    equal_weights: bool,
    report: Report,
    tell: Tell,
) -> Identification:
    """Fit what takes part of records of any excitation, and return it among all channels.

    Periods that are too few to separate all inputs may separate those that move.
    """
    some = taking_part(fitting, parts)
    orders, remarks = _orders([some.fitting[0][0]], modes), some.remarks
    periodic = None if some.parts is parts or _in_a_known_loop(fitting) else realisations_of(some.fitting)
    if periodic is None and equal_weights:
        remarks = (*remarks, "equal weights have no effect: no excitation of these records repeats")
    for remark in remarks:
        tell(remark)
    if periodic is not None:
        found = _from_periods(periodic, some.parts, orders, name, equal_weights, report)
    else:
        fit = _from_spectra if too_long(some.fitting) else _from_records
        found = fit(some.fitting, some.parts, orders, name, report)
    found = with_all_channels(found, *_ports(fitting[0][0]), fitting)
    return replace(found, remarks=(*remarks, *found.remarks))


def _missing(runs: Sequence[Run]) -> str:
    told = [f"; {run.path.name}: {fact.finding}" for run in runs for fact in facts_of(run) if fact.name == "missing"]
    return told[0] if told else ""


def _orders(runs: Sequence[Run], modes: int | Sequence[int] | None) -> tuple[int, ...]:
    if modes is not None:
        return (modes,) if isinstance(modes, int) else tuple(modes)
    n_u = len(runs[0].names("input")) if runs else 1
    return tuple(n * max(n_u, 1) for n in ORDERS)


def _from_periods(
    data: Realisations,
    parts: Parts,
    orders: tuple[int, ...],
    name: str,
    equal_weights: bool,
    report: Report,
) -> Identification:
    means = [x.mean(axis=(0, 3)) for x in (data.inputs, data.outputs)]
    bring_to_one_level(data)
    settled, measured, chosen = settled_response(data, orders, equal_weights, report)
    report(0.8, 1.0, "giving up modes that are not there")
    fit, lines, variance, held = chosen.fit, chosen.lines, chosen.variance, chosen.intersample == "held"

    def again(n: int, first: ModalModel | None) -> RationalFit:
        return fit_lines(lines, variance, data.rate_hz, (n,), first, delay=chosen.delay)

    def errors(one: RationalFit) -> tuple[HeldOut, ...]:
        late = one.model.with_(delay_s=one.model.delay_s + chosen.whole_s)
        return tried(late, parts, data.rate_hz, intersample=chosen.intersample)

    fit = with_pairs_merged(without_undetermined(fit, orders, again), orders, again, errors)
    power = float(measured.output_power.sum())
    ratios = [_relative(level, power) for level in (measured.output_noise, measured.output_distortion)]
    noise = _relative(noise_power(settled), power)
    if variance is not None and not _within_noise(fit) and _distorted(*ratios):
        # weights by the noise follow the quietest lines, although the residual there is not noise
        even = fit_lines(lines, None, data.rate_hz, (fit.model.n_blocks,), fit.model, delay=chosen.delay)
        # how far noise explains it is told by the other
        fit = replace(even, chi2=fit.chi2, dof=fit.dof, dropped=fit.dropped)
    if chosen.whole_s.any():
        fit = replace(fit, model=fit.model.with_(delay_s=chosen.whole_s))
    fitted = fitted_by(fit, None if variance is None else fit.chi2, fit.dof, _rest(fit.model, *means))
    if held and variance is not None and _within_noise(fit) and not _distorted(*ratios):
        report(0.9, 1.0, "fitting in time")
        fitted = _refined(fitted, parts, data.rate_hz, Structure(delay=chosen.delay), late=may_be_late(parts[0][0]))
    found = identification(
        fitted,
        _runs_of(parts),
        *_ports(parts[0][0]),
        method="periodic, zero-order hold" if held else "periodic, band-limited",
        name=name,
        intersample=chosen.intersample,
        levels=(noise, ratios[1]),
        held_out=tried(fitted.linear, parts, data.rate_hz, intersample=chosen.intersample),
        response=curves_of_periods(measured, *(tuple(parts[0][0].names(role)) for role in ROLES)),
    )
    # where the bench is not linear, the swing that was taken out is not all that dies away
    return replace(found, noise_is_bound=settled is not data)


def _within_noise(fit: RationalFit) -> bool:
    """Tell whether the scatter of the lines explains what a fit misses, to three standard deviations."""
    return bool(fit.chi2 < fit.dof + 3.0 * np.sqrt(2.0 * fit.dof))


def _distorted(noise: float | None, distortion: float | None) -> bool:
    """Tell whether more of the output is distortion than noise, where the record can tell both."""
    return noise is not None and distortion is not None and distortion > noise


def _refined(fitted: Fitted, parts: Parts, rate_hz: float, structure: Structure, *, late: bool) -> Fitted:
    """Return a model fitted on in time to all segments that are not held out, with the quality of its response."""
    kept = [(run, s) for run, s in parts if s.rows and not s.held_out]
    if too_long(kept):
        return fitted
    inputs, outputs = ([channels_of(run, s, role) for run, s in kept] for role in ROLES)
    fit = refined(fitted.linear, inputs, outputs, rate_hz, structure, fitted.offsets.mean(axis=0), late=late)
    if fit is None:
        return fitted
    return fitted_by(fit, fitted.chi2, fitted.dof, np.array(fit.offsets), fitted.dropped)


def _relative(level: Array, power: float) -> float | None:
    """A level over the output, both as rms; None where the record cannot tell it."""
    total = float(level.sum())
    return float(np.sqrt(max(total, 0.0) / power)) if np.isfinite(total) and power > 0.0 else None


def _from_records(
    fitting: Parts,
    parts: Parts,
    orders: tuple[int, ...],
    name: str,
    report: Report,
) -> Identification:
    """Fit in time, and give up modes that are not there.

    What no linear model explains is not noise, so the criterion finds modes in it; their frequency or damping is then
    nothing that the data determine.
    """
    rate = fitting[0][0].sample_rate_hz
    inputs, outputs = ([channels_of(run, s, role) for run, s in fitting] for role in ROLES)
    axes = fit_axes(fitting, inputs, outputs, orders, report)
    if axes is not None:
        return _of_axes(axes, parts, name)
    choosing = len(orders) > 1  # a number that is given is fitted once, and tells of a loop by itself
    # the direct method is consistent in a loop, with noise of any colour, for a plant that acts from the next sample on
    known = _in_a_known_loop(fitting)
    looped = known or (choosing and in_a_loop(inputs, outputs, rate, orders[0]))
    if choosing and not looped and max(s.rows for _, s in fitting) > MANY_ROWS:
        return _from_spectra(fitting, parts, orders, name, report)
    fit = fit_in_time(fitting, inputs, outputs, orders, looped, report)

    def errors(one: TimeFit) -> tuple[HeldOut, ...]:
        return tried(one.model, parts, rate, np.array(one.offsets).mean(axis=0))

    fit = with_pairs_merged(fit, orders, partial(fitted_again, fit, inputs, outputs, rate, looped), errors)
    offsets = np.array(fit.offsets)
    return identification(
        fitted_by(fit, fit.chi2, fit.dof, offsets),
        _runs_of(parts),
        *_ports(parts[0][0]),
        method="free, in a loop" if known else "free",
        name=name,
        held_out=tried(fit.model, parts, rate, offsets.mean(axis=0)),
    )


def _from_spectra(
    fitting: Parts,
    parts: Parts,
    orders: tuple[int, ...],
    name: str,
    report: Report,
) -> Identification:
    """Fit the averaged response of records that are too long to be fitted in time.

    What it scatters by holds what is not linear, so that this is not taken for modes.
    """
    rate = fitting[0][0].sample_rate_hz
    measured, u, y = averaged_response(fitting, part_of(report, 0.0, 0.5))
    whole = _whole_delay(fitting)
    lines = response_freed(measured, whole, rate)
    variance = pooled_variance(lines)
    fit = fit_lines(lines, variance, rate, orders, report=part_of(report, 0.5, 0.9))

    def again(n: int, first: ModalModel | None) -> RationalFit:
        return fit_lines(lines, variance, rate, (n,), first)

    def errors(one: RationalFit) -> tuple[HeldOut, ...]:
        late = one.model.with_(delay_s=whole / rate)
        return tried(late, parts, rate, _rest(late, u, y).mean(axis=0))

    fit = with_pairs_merged(without_undetermined(fit, orders, again), orders, again, errors)
    fit = replace(fit, model=fit.model.with_(delay_s=whole / rate))
    fitted = fitted_by(fit, fit.chi2, fit.dof, _rest(fit.model, u, y))
    report(0.9, 1.0, "fitting in time")
    fitted = _refined(fitted, fitting, rate, Structure(), late=may_be_late(fitting[0][0]))
    return identification(
        fitted,
        _runs_of(parts),
        *_ports(parts[0][0]),
        method="free, averaged spectra",
        name=name,
        held_out=tried(fitted.linear, parts, rate, fitted.offsets.mean(axis=0)),
        response=curves_of_periods(measured, *(tuple(parts[0][0].names(role)) for role in ROLES)),
    )


def _whole_delay(fitting: Parts) -> Array:
    """Return by how many whole samples each input (n_u,) acts late, from the first samples of the longest segment."""
    run, longest = max(fitting, key=lambda part: part[1].rows)
    if not may_be_late(run):
        return np.zeros(len(run.names("input")))
    some = replace(longest, stop=min(longest.stop, longest.start + BEGINNING_ROWS))
    u, y = (channels_of(run, some, role) for role in ROLES)
    return beginning([u], [y]).whole.astype(float)


def _of_axes(axes: Axes, parts: Parts, name: str) -> Identification:
    """Return the identification of axes that move by themselves; a torque that is always there goes with it."""
    fitted, (inputs, outputs) = axes.fitted, _ports(parts[0][0])
    beside = [(inputs[i].dof, one) for i, one in enumerate(axes.beside) if one is not None]
    words = ["free"] + ["axis by axis"] * (len(axes.beside) > 1)
    if beside:
        words.append("beside friction" if any(one.friction > 0.0 for _, one in beside) else "beside a constant torque")
    # a record that friction or a torque bends is none to try a linear model on
    rate, offsets = parts[0][0].sample_rate_hz, fitted.offsets
    held_out = () if beside else tried(fitted.linear, parts, rate, offsets.mean(axis=0))
    method = ", ".join(words)
    found = identification(fitted, _runs_of(parts), inputs, outputs, method=method, name=name, held_out=held_out)
    source = f"{method} fit to run {', '.join(run.run_uid for run in _runs_of(parts))}"
    points = [
        EffectEntry(
            effect="constant-torque",
            where=dof,
            parameters={"torque": Quantity(value=one.constant, origin="fitted", source=source, std=one.constant_std)},
            note="operating point of the recorded input, not physics",
        )
        for dof, one in beside
    ]
    return replace(found, model=msgspec.structs.replace(found.model, effects=[*found.model.effects, *points]))


def _rest(model: ModalModel, u: Array, y: Array) -> Array:
    """Return (n, n_y) what mean outputs (n_y, n) read beyond what the model makes of the mean inputs (n_u, n)."""
    if np.any(model.omega_rad_s == 0.0):  # a rigid body drifts away under any mean input: there was none
        return np.asarray(y.T)
    return np.asarray((y - model.frequency_response(np.zeros(1))[0].real @ u).T)


def _require_same_channels(runs: Sequence[Run]) -> None:
    first = runs[0]
    for run in runs[1:]:
        for role in ROLES:
            own, wanted = (", ".join(one.names(role)) or "none" for one in (run, first))
            if own != wanted:
                raise DataError(f"{run.path} has the {role}s {own}, {first.path} has {wanted}; identify them apart")
        if run.sample_rate_hz != first.sample_rate_hz:
            raise DataError(
                f"{run.path} has {run.sample_rate_hz:g} Hz, {first.path} has {first.sample_rate_hz:g} Hz; identify "
                "them apart, or import both at one rate"
            )
    for role in ROLES:
        if not first.names(role):
            raise DataError(f"{first.path} has no {role} channel; give that role to at least one when importing")


def _ports(run: Run) -> tuple[list[Port], list[Port]]:
    def of(role: str) -> list[Port]:
        return [Port(name=n, unit=run.channels[n].unit, dof=run.channels[n].dof or n) for n in run.names(role)]

    return of("input"), of("output")


def _in_a_known_loop(parts: Parts) -> bool:
    """Tell whether the facts of a log say that its inputs answer its outputs."""
    return any(fact.name == LOOP and fact.numbers.get("found") for run in _runs_of(parts) for fact in facts_of(run))


def _runs_of(parts: Parts) -> list[Run]:
    return list({id(run): run for run, _ in parts}.values())
