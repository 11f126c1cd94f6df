"""Axes with a drive each: every one is fitted alone to what is read of it, then what the drives of others add to it.

Fitted together, free axes share slow modes that no number of samples separates, each number of modes
takes minutes, and the friction of one bends the model of all. What moves an axis is its own drive; the others are
inputs like any other, which act on it or do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from analysis.identification.determined import SIGNIFICANT
from analysis.identification.free_axis import fit_free_axis, lags_for_certain
from analysis.identification.identified import Fitted, deviations, side_by_side
from analysis.identification.in_time import fit_in_time, in_a_loop
from analysis.identification.inverse_dynamics import Balance, balance_of
from analysis.identification.pushed import pushed
from analysis.identification.timefit import TimeFit, fit_records
from campaigns.log import LogSegment, Run
from campaigns.progress import Report, part_of
from sim_backend.linear import Array, ModalModel


@dataclass(frozen=True)
class Axes:
    """A linear model of all axes, and what stands beside it.

    `beside` (n_u,) holds the balance of torques of each drive where friction or a constant torque stands beside its
    linear model.
    """

    fitted: Fitted
    beside: tuple[Balance | None, ...]


@dataclass(frozen=True)
class _Axis:
    """The model of what one drive moves: `readings` from `drives`, its own first, with deviations and its fit."""

    drives: list[int]
    readings: list[int]
    linear: ModalModel
    std: ModalModel
    fit: TimeFit | None
    balance: Balance | None


@dataclass(frozen=True)
class Moved:
    """What one drive moves: `readings`, of several the one first whose balance of torques explains most."""

    readings: list[int]
    balance: Balance | None


def moved_by(inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float) -> list[Moved] | None:
    """Return what each drive moves in records (n, n_u) and (n, n_y); None unless every reading is one drive's.

    One axis at least has to be free, or all have to rub: what is held and does not rub is not a case for a balance.
    """
    n_u, n_y = inputs[0].shape[1], outputs[0].shape[1]
    if n_u > n_y:
        return None
    found = [[balance_of(_only(inputs, [i]), _only(outputs, [j]), rate_hz) for i in range(n_u)] for j in range(n_y)]
    explained = np.array([[0.0 if one is None else one.explained for one in row] for row in found])
    readings, of = scipy.optimize.linear_sum_assignment(explained, maximize=True)
    drives = np.argmax(explained, axis=1)
    drives[readings] = of
    balances = [row[i] for row, i in zip(found, drives, strict=True)]
    known = [one is not None for one in balances]
    if not (all(known) or (n_y == n_u and any(one is not None and one.free for one in balances))):
        return None
    moved = []
    for own in range(n_u):
        mine = sorted(np.flatnonzero(drives == own).tolist(), key=lambda j: -explained[j, own])
        # what other drives add is known once it is known which
        some = _own_first(own, n_u)
        moved.append(Moved(mine, balance_of(_only(inputs, some), _only(outputs, mine[:1]), rate_hz)))
    return moved


def fit_axes(
    fitting: Sequence[tuple[Run, LogSegment]],
    inputs: Sequence[Array],
    outputs: Sequence[Array],
    orders: tuple[int, ...],
    report: Report,
) -> Axes | None:
    """Return the fit of every axis to inputs (n, n_u) and outputs (n, n_y) of all segments; None for other plants.

    `orders` are numbers of modes of all axes together.
    """
    rate, n = fitting[0][0].sample_rate_hz, inputs[0].shape[1]
    moved = moved_by(inputs, outputs, rate)
    if moved is None:
        return None
    each = tuple(sorted({max(order // n, 1) for order in orders}))
    axes = []
    for own, one in enumerate(moved):
        told = part_of(report, 0.8 * own / n, 0.8 * (own + 1) / n)
        u, y = _only(inputs, [own]), _only(outputs, one.readings)
        if one.balance is not None and (one.balance.friction > 0.0 or one.balance.pushed):
            axes.append(_balanced(one.balance, one.readings, inputs, y, rate, own))
            continue
        if one.balance is not None:
            fit = fit_free_axis(fitting, u, y, each, told)
        else:
            looped = len(each) > 1 and in_a_loop(u, y, rate, each[0])
            fit = fit_in_time(fitting, u, y, each, looped, told)
        axes.append(_Axis([own], one.readings, fit.model, deviations(fit), fit, None))
    late = np.array([axis.linear.delay_s[0] for axis in axes])
    report(0.8, 1.0, "fitting what other drives add")
    axes = [_coupled(axis, inputs, _only(outputs, axis.readings), rate, late) for axis in axes]
    return Axes(_together(axes, outputs), tuple(axis.balance for axis in axes))


def _balanced(
    balance: Balance, readings: list[int], inputs: Sequence[Array], y: Sequence[Array], rate_hz: float, own: int
) -> _Axis:
    """Return the axis of the balance of its first reading, with the drives that act on it and its other readings."""
    acting = np.flatnonzero(balance.linear.b[0])
    drives = [_own_first(own, inputs[0].shape[1])[i] for i in acting]
    linear, std = (model.driven_by(acting) for model in (balance.linear, balance.std))
    rows = np.concatenate([record - record.mean(axis=0) for record in y])
    ratios = (rows[:, :1].T @ rows / np.sum(rows[:, 0] ** 2)).T
    some = replace(
        balance,
        linear=linear.with_(c=ratios, c_rate=np.zeros_like(ratios), d=np.zeros((ratios.size, acting.size))),
        std=std.with_(c=np.zeros_like(ratios), c_rate=np.zeros_like(ratios), d=np.zeros((ratios.size, acting.size))),
    )
    if balance.friction == 0.0:
        some = pushed(some, _only(inputs, drives), y, rate_hz)
    return _Axis(drives, readings, some.linear, some.std, None, some)


def _coupled(axis: _Axis, inputs: Sequence[Array], y: Sequence[Array], rate_hz: float, late: Array) -> _Axis:
    """Return the axis with what other drives do to it, where that is known and the data are better for it.

    `late` (n_u,) is the delay of each drive, as its own axis tells it. A balance has its couplings already.
    """
    fit, own = axis.fit, axis.drives[0]
    if fit is None or late.size == 1:
        return axis

    def fitted(drives: list[int], form: str, model: ModalModel) -> TimeFit:
        u, structure = _only(inputs, drives), replace(fit.structure, form=form, delay=False)
        return fit_records(u, y, rate_hz, model.n_blocks, structure=structure, rigid_bodies=None, start=model)

    def beside(drives: list[int]) -> TimeFit:
        none = np.zeros((fit.model.n_blocks, len(drives) - 1))
        alone = fit.model.with_(
            b=np.hstack([fit.model.b, none]),
            b_direct=np.hstack([fit.model.b_direct, none]),
            d=np.pad(fit.model.d, ((0, 0), (0, len(drives) - 1))),
            delay_s=late[drives],
        )
        return fitted(drives, fit.structure.form, alone)

    drives = _own_first(own, late.size)
    more = beside(drives)
    std = deviations(more)
    act = (np.abs(more.model.b) > SIGNIFICANT * std.b) | (np.abs(more.model.b_direct) > SIGNIFICANT * std.b_direct)
    known = [drive for drive, acts in zip(drives, np.any(act, axis=0), strict=True) if acts and drive != own]
    if len(known) < len(drives) - 1:
        drives = [own, *known]
        more = beside(drives)
    if not known or more.criterion >= fit.criterion:
        return axis
    if fit.structure.form == "mechanical":  # what other drives do had hidden when the readings are taken
        general = fitted(drives, "general", more.model)
        more = min((more, general) if lags_for_certain(general) else (more,), key=lambda one: one.criterion)
    delay = np.where(np.array(drives) == own, axis.std.delay_s[0], 0.0)
    return _Axis(drives, axis.readings, more.model, deviations(more).with_(delay_s=delay), more, None)


def _together(axes: Sequence[_Axis], outputs: Sequence[Array]) -> Fitted:
    """Return one model of all axes to `outputs` in their order; a drive has one delay in the fits of all axes."""
    drives, readings = [axis.drives for axis in axes], [axis.readings for axis in axes]
    linear, std = (side_by_side([getattr(axis, key) for axis in axes], drives, readings) for key in ("linear", "std"))
    fits = [axis.fit for axis in axes if axis.fit is not None]
    if len(fits) < len(axes):
        return Fitted(linear, std, None, sum(y.size for y in outputs))
    order = np.argsort([j for some in readings for j in some])
    offsets = np.array([np.concatenate(some)[order] for some in zip(*(fit.offsets for fit in fits), strict=True)])
    return Fitted(linear, std, sum(fit.chi2 for fit in fits), sum(fit.dof for fit in fits), offsets)


def _own_first(own: int, n: int) -> list[int]:
    return [own, *(i for i in range(n) if i != own)]


def _only(records: Sequence[Array], columns: Sequence[int]) -> list[Array]:
    return [record[:, list(columns)] for record in records]
