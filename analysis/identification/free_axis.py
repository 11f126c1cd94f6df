"""A free axis, without a suspension, fitted in time: its inertia and drag, its resonances, the time of its readings.

A torque takes time to move what has inertia: there is no feedthrough, whatever a loop around the axis makes of its
noise. Nor is there a position of rest, so that no offset is fitted. What is not linear drifts, and a criterion that
knows only noise makes slow modes of the drift; a real mode of such an axis oscillates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.identification.determined import SIGNIFICANT, determinedness, swinging, without_undetermined
from analysis.identification.in_time import may_be_late
from analysis.identification.input_delay import with_delay
from analysis.identification.modal_parameters import Structure
from analysis.identification.timefit import TimeFit, fit_records, with_one_more
from campaigns.log import LogSegment, Run
from campaigns.progress import Report, part_of
from sim_backend.linear import Array, ModalModel

_MECHANICAL = Structure("mechanical", feedthrough=False, offset=False)
_GENERAL = replace(_MECHANICAL, form="general")


def fit_free_axis(
    fitting: Sequence[tuple[Run, LogSegment]],
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    orders: tuple[int, ...],
    report: Report,
) -> TimeFit:
    """Return the fit to a free axis, inputs (n, 1) and outputs (n, n_y), by as many modes as it shows.

    Modes are counted as mechanical ones, whose fits drift least. What else the readings hold (one that is taken a
    little later than the command is given, a mode that drag makes lag) is fitted from there, and a spring that cannot
    be distinguished from none is left out.
    """
    rate = fitting[0][0].sample_rate_hz

    def fitted(structure: Structure, n: int, start: ModalModel | None) -> TimeFit:
        return fit_records(inputs, outputs, rate, n, structure=structure, rigid_bodies=None, start=start)

    told = part_of(report, 0.0, 0.7)
    first = fit_records(inputs, outputs, rate, orders, structure=_MECHANICAL, rigid_bodies=None, report=told)
    fit = without_undetermined(first, orders, lambda n, start: fitted(_MECHANICAL, n, start), swinging)
    dropped = fit.dropped
    report(0.7, 1.0, "fitting when the readings are taken")
    fits = [fit]
    for start in _starts(first, fit, orders[0]):
        more = fitted(_GENERAL, start.n_blocks, start)
        if lags_for_certain(more):
            fits.append(more)
    fit = min(fits, key=lambda one: one.criterion)
    omega = fit.model.omega_rad_s
    if np.any(held := (omega > 0.0) & (omega < SIGNIFICANT * fit.omega_std_rad_s) & (omega < fit.model.sigma_1_s)):
        released = fitted(fit.structure, omega.size, fit.model.with_(omega_rad_s=np.where(held, 0.0, omega)))
        fit = min(released, fit, key=lambda one: one.criterion)
    # what a late reading leaves hides what is flexible, and is told by now
    while fit.model.n_blocks < orders[-1]:
        more = with_one_more(fit, inputs, outputs, rate)
        if more.criterion >= fit.criterion or np.min(swinging(more)) < SIGNIFICANT:
            break
        fit = more
    fit = replace(fit, dropped=dropped)
    if not may_be_late(fitting[0][0]):
        return fit
    report(0.9, 1.0, "fitting a delay")
    return with_delay(fit, inputs, outputs, rate)


def _starts(first: TimeFit, fit: TimeFit, fewest: int) -> list[ModalModel]:
    """Return the models from which a general form is fitted: `fit`, and what may be true of it and of `first`."""
    starts, fastest = [fit.model], int(np.argmax(fit.model.sigma_1_s))
    if fit.model.n_blocks > fewest:  # the fastest mode may stand for no more than when the readings are taken
        starts.append(fit.model.only(np.arange(fit.model.n_blocks) != fastest))
    sure = swinging(first) >= SIGNIFICANT
    if fewest < np.sum(sure) < sure.size:  # modes that are given up one at a time may take others with them
        starts.append(first.model.only(sure))
    return starts


def lags_for_certain(fit: TimeFit) -> bool:
    """Tell whether the data determine all modes of a fit in general form, and that a rate is in the readings."""
    place = fit.layout.index("c_rate")
    lead = np.abs(fit.model.c_rate) > SIGNIFICANT * np.sqrt(np.diag(fit.covariance)[place])
    return bool(np.any(lead) and np.min(determinedness(fit)) >= SIGNIFICANT)
