"""Axes with a drive each: every one is fitted alone to what is read of it, then what the drives of others add to it.

Fitted together, axes that nothing holds share slow modes that no number of rows tells apart, each number of modes takes
minutes, and the friction of one bends the model of all. What moves an axis is its own drive; the others are inputs like
any other, which act on it or do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.optimize import linear_sum_assignment

from analysis.identification.determined import SIGNIFICANT
from analysis.identification.free_axis import fit_free_axis, lags_for_certain
from analysis.identification.identified import Fitted, deviations
from analysis.identification.in_time import fit_in_time, in_a_loop
from analysis.identification.inverse_dynamics import Balance, balance_of
from analysis.identification.pushed import pushed
from analysis.identification.timefit import TimeFit, fit_records
from campaigns.log import LogSegment, Run
from campaigns.progress import Report, part_of
from sim_backend.linear import Array, ModalModel

IntArray = NDArray[np.intp]


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

    One axis at least has to be free, or all have to rub: what is held and does not rub is no case for a balance.
    """
    n_u, n_y = inputs[0].shape[1], outputs[0].shape[1]
    if n_u > n_y:
        return None
    found = [[balance_of(_only(inputs, [i]), _only(outputs, [j]), rate_hz) for i in range(n_u)] for j in range(n_y)]
    explained = np.array([[0.0 if one is None else one.explained for one in row] for row in found])
    readings, of = linear_sum_assignment(explained, maximize=True)
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
        told = part_of(report, own / n, (own + 0.8) / n)
        u, y = _only(inputs, [own]), _only(outputs, one.readings)
        if one.balance is not None and (one.balance.friction > 0.0 or one.balance.pushed):
            axes.append(_balanced(one, inputs, y, rate, own))
            continue
        if one.balance is not None:
            fit = fit_free_axis(fitting, u, y, each, told)
        else:
            looped = len(each) > 1 and in_a_loop(u, y, rate, each[0])
            fit = fit_in_time(fitting, u, y, each, looped, told)
        axes.append(_Axis([own], one.readings, fit.model, _deviations(fit), fit, None))
    late = np.array([axis.linear.delay_s[0] for axis in axes])
    for own, axis in enumerate(list(axes)):
        report(own + 0.8, n, "fitting what other drives add")
        axes[own] = _coupled(axis, inputs, _only(outputs, axis.readings), rate, late)
    return Axes(_together(axes, late, outputs), tuple(axis.balance for axis in axes))


def _balanced(moved: Moved, inputs: Sequence[Array], y: Sequence[Array], rate_hz: float, own: int) -> _Axis:
    """Return the axis of the balance of its first reading, with the drives that act on it and its other readings."""
    balance = moved.balance
    assert balance is not None
    acting = np.flatnonzero(balance.linear.b[0])
    drives = [_own_first(own, inputs[0].shape[1])[i] for i in acting]
    linear, std = (_inputs(model, acting) for model in (balance.linear, balance.std))
    rows = np.concatenate([record - record.mean(axis=0) for record in y])
    ratios = (rows[:, :1].T @ rows / np.sum(rows[:, 0] ** 2)).T
    some = replace(
        balance,
        linear=linear.with_(c=ratios, c_rate=np.zeros_like(ratios), d=np.zeros((ratios.size, acting.size))),
        std=std.with_(c=np.zeros_like(ratios), c_rate=np.zeros_like(ratios), d=np.zeros((ratios.size, acting.size))),
    )
    if balance.friction == 0.0:
        some = pushed(some, _only(inputs, drives), y, rate_hz)
    return _Axis(drives, moved.readings, some.linear, some.std, None, some)


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
        alone = _among(fit.model, [0], len(drives)).with_(delay_s=late[drives])
        return fitted(drives, fit.structure.form, alone)

    drives = _own_first(own, late.size)
    more = beside(drives)
    std = _deviations(more)
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
    return _Axis(drives, axis.readings, more.model, _deviations(more).with_(delay_s=delay), more, None)


def _together(axes: Sequence[_Axis], late: Array, outputs: Sequence[Array]) -> Fitted:
    """Return one model of all axes, whose drives are late by `late` (n_u,), to `outputs` in their order."""
    order = np.argsort([j for axis in axes for j in axis.readings])
    linear, std = (
        _stacked([_among(getattr(axis, key), axis.drives, late.size) for axis in axes], order)
        for key in ("linear", "std")
    )
    spread = np.array([axis.std.delay_s[0] for axis in axes])
    linear, std = linear.with_(delay_s=late), std.with_(delay_s=spread)
    fits = [axis.fit for axis in axes if axis.fit is not None]
    if len(fits) < len(axes):
        return Fitted(linear, std, None, sum(y.size for y in outputs))
    offsets = np.array([np.concatenate(some)[order] for some in zip(*(fit.offsets for fit in fits), strict=True)])
    return Fitted(linear, std, sum(fit.chi2 for fit in fits), sum(fit.dof for fit in fits), offsets)


def _stacked(models: Sequence[ModalModel], order: IntArray) -> ModalModel:
    """Return one model with the blocks of all and their outputs in an order; all have the same inputs."""
    long = {key: np.concatenate([getattr(m, key) for m in models]) for key in ("b", "b_direct")}
    flat = {key: np.concatenate([getattr(m, key) for m in models]) for key in ("omega_rad_s", "sigma_1_s")}
    wide = {key: block_diag(*(getattr(m, key) for m in models))[order] for key in ("c", "c_rate")}
    direct = np.concatenate([m.d for m in models])[order]
    return ModalModel(**flat, **long, **wide, d=direct, delay_s=models[0].delay_s)


def _among(model: ModalModel, places: Sequence[int], n: int) -> ModalModel:
    """Return the model with its inputs at some places among `n`; the others do nothing."""

    def spread(array: Array) -> Array:
        out = np.zeros((*array.shape[:-1], n))
        out[..., places] = array
        return out

    return model.with_(**{key: spread(getattr(model, key)) for key in ("b", "b_direct", "d", "delay_s")})


def _inputs(model: ModalModel, some: IntArray) -> ModalModel:
    """Return the model from some of its inputs."""
    return model.with_(**{key: getattr(model, key)[..., some] for key in ("b", "b_direct", "d", "delay_s")})


def _deviations(fit: TimeFit) -> ModalModel:
    return deviations(fit.model, fit.layout, fit.covariance, fit.omega_std_rad_s, fit.sigma_std_1_s)


def _own_first(own: int, n: int) -> list[int]:
    return [own, *(i for i in range(n) if i != own)]


def _only(records: Sequence[Array], columns: Sequence[int]) -> list[Array]:
    return [record[:, list(columns)] for record in records]
