"""Records of any waveform fitted in time: what is assumed of the plant, and how many modes are tried."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from analysis.identification.determined import SIGNIFICANT, determinedness, swinging, without_undetermined
from analysis.identification.input_delay import with_delay
from analysis.identification.loop_at_once import answers_at_once
from analysis.identification.modal_parameters import Structure
from analysis.identification.response_fit import RationalFit
from analysis.identification.timefit import TimeFit, fit_records, with_one_more
from campaigns.log import LogSegment, Run
from campaigns.progress import Report, part_of
from sim_backend.linear import Array, ModalModel

_SOME_ROWS = 20_000
"""Rows of the longest record that tell whether there is a loop: with feedthrough in one each order takes minutes."""


def fit_in_time(
    fitting: Sequence[tuple[Run, LogSegment]],
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    orders: tuple[int, ...],
    looped: bool,
    report: Report,
) -> TimeFit:
    """Return the fit to the inputs (n, n_u) and outputs (n, n_y) of all segments, by as many modes as they show.

    Without feedthrough where a loop answers at once, as a first fit tells (`looped`) or this one; with a delay where
    there is one.
    """
    rate = fitting[0][0].sample_rate_hz

    def fitted(structure: Structure) -> TimeFit:
        fit = _fitted(inputs, outputs, rate, orders, structure, part_of(report, 0.0, 0.9))
        return _perhaps_late(fit, fitting, inputs, outputs, structure, report)

    fit = fitted(Structure(feedthrough=not looped))
    if np.any(fit.model.d) and answers_at_once(fit, inputs, outputs):  # a first fit may miss too much to tell
        fit = fitted(Structure(feedthrough=False))
    return fit


def fit_free_axis(
    fitting: Sequence[tuple[Run, LogSegment]],
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    orders: tuple[int, ...],
    report: Report,
) -> TimeFit:
    """Return the fit to an axis that nothing holds, inputs (n, 1) and outputs (n, 1), by as many modes as it shows.

    A torque takes time to move what has inertia: there is no feedthrough, whatever a loop around the axis makes of its
    noise. Modes are counted as mechanical ones, whose fits drift least; what else their readings hold (a reading that
    is taken a little later than the command is given) is fitted from there, and a spring that cannot be told from none
    is none.
    """
    rate = fitting[0][0].sample_rate_hz
    mechanical = Structure("mechanical", feedthrough=False, offset=False)
    fit = _fitted(inputs, outputs, rate, orders, mechanical, part_of(report, 0.0, 0.7), swinging)
    report(0.7, 1.0, "fitting when the readings are taken")

    def other(structure: Structure, start: ModalModel) -> TimeFit:
        return fit_records(inputs, outputs, rate, start.n_blocks, structure=structure, rigid_bodies=None, start=start)

    general, slowest = replace(mechanical, form="general"), np.argsort(fit.model.sigma_1_s)
    fits = [(fit, mechanical), (other(general, fit.model), general)]
    if slowest.size > 1:  # the fastest mode may stand for no more than when the readings are taken
        fits.append((other(general, fit.model.only(np.arange(slowest.size) != slowest[-1])), general))
    told = [(one, form) for one, form in fits if form is mechanical or _late_for_certain(one)]
    fit, structure = min(told, key=lambda one: one[0].criterion)
    omega = fit.model.omega_rad_s
    if np.any(held := (omega > 0.0) & (omega < SIGNIFICANT * fit.omega_std_rad_s) & (omega < fit.model.sigma_1_s)):
        released = other(structure, fit.model.with_(omega_rad_s=np.where(held, 0.0, omega)))
        fit = min(released, fit, key=lambda one: one.criterion)
    # what a late reading leaves hides what is flexible, and is told by now
    while fit.model.n_blocks < orders[-1]:
        more = with_one_more(fit, inputs, outputs, rate, structure)
        if more.criterion >= fit.criterion or np.min(swinging(more)) < SIGNIFICANT:
            break
        fit = more
    return _perhaps_late(fit, fitting, inputs, outputs, structure, report)


def _late_for_certain(fit: TimeFit) -> bool:
    """Tell whether the data determine all modes of a fit in general form, and that a rate is in the readings."""
    place = fit.layout.index("c_rate")
    lead = np.abs(fit.model.c_rate) > SIGNIFICANT * np.sqrt(np.diag(fit.covariance)[place])
    return bool(np.any(lead) and np.min(determinedness(fit)) >= SIGNIFICANT)


def in_a_loop(inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float, blocks: int) -> bool:
    """Tell by a fit of so many blocks to some rows of the longest record whether a loop answers at once."""
    longest = max(range(len(inputs)), key=lambda i: inputs[i].shape[0])
    u, y = [inputs[longest][:_SOME_ROWS]], [outputs[longest][:_SOME_ROWS]]
    return answers_at_once(fit_records(u, y, rate_hz, blocks, rigid_bodies=None), u, y)


def _fitted(
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    rate: float,
    orders: tuple[int, ...],
    structure: Structure,
    report: Report,
    measure: Callable[[TimeFit | RationalFit], Array] = determinedness,
) -> TimeFit:
    def again(n: int, first: ModalModel | None) -> TimeFit:
        return fit_records(inputs, outputs, rate, n, structure=structure, rigid_bodies=None, start=first)

    told = part_of(report, 0.0, 0.9)
    fit = fit_records(inputs, outputs, rate, orders, structure=structure, rigid_bodies=None, report=told)
    report(0.9, 1.0, "giving up modes that are not there")
    return without_undetermined(fit, orders, again, measure)


def _perhaps_late(
    fit: TimeFit,
    fitting: Sequence[tuple[Run, LogSegment]],
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    structure: Structure,
    report: Report,
) -> TimeFit:
    run, _ = fitting[0]
    if run.header.bench.get("kind") != "imported":  # our own bench has no delay
        return fit
    report(0.9, 1.0, "fitting a delay")
    return with_delay(fit, inputs, outputs, run.sample_rate_hz, structure)
