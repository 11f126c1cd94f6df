"""Modes that the data determine: a criterion that knows only noise finds modes in whatever no linear model explains."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from analysis.identification.response_fit import RationalFit
from analysis.identification.timefit import TimeFit
from sim_backend.linear import Array, ModalModel

_AnyFit = TypeVar("_AnyFit", TimeFit, RationalFit)

SIGNIFICANT = 3.0
"""Standard deviations by which a mode's decay rate must differ from zero."""


def without_undetermined(
    fit: _AnyFit, orders: tuple[int, ...], again: Callable[[int, ModalModel | None], _AnyFit]
) -> _AnyFit:
    """Return the fit with no mode that the data leave undetermined, fitted `again` with one fewer each time.

    A fit with one fewer may start from what is left of the last one: a start found anew may miss a mode that the larger
    number had found, because its method puts a pole where nothing was played. The better of both counts.
    """
    while fit.model.n_blocks > orders[0] and np.min(known := _determinedness(fit)) < SIGNIFICANT:
        rest = fit.model.only(np.arange(known.size) != int(np.argmin(known)))
        fit = min((again(rest.n_blocks, None), again(rest.n_blocks, rest)), key=lambda one: one.criterion)
    return fit


def _determinedness(fit: TimeFit | RationalFit) -> Array:
    """Return by how many standard deviations each block's frequency and decay rate differ from zero, the lesser (m,).

    A rigid body has neither, and is there or not by the criterion. One that is braked has a decay rate alone: a block
    that is overdamped for certain has two poles apart, of which the slow one may be at rest.
    """
    model = fit.model
    frequency = _ratio(model.omega_rad_s, fit.omega_std_rad_s)
    decay = _ratio(model.sigma_1_s, fit.sigma_std_1_s)
    braked = model.omega_rad_s + SIGNIFICANT * fit.omega_std_rad_s < model.sigma_1_s
    return np.where(model.omega_rad_s > 0.0, np.where(braked, decay, np.minimum(frequency, decay)), np.inf)


def _ratio(value: Array, std: Array) -> Array:
    """Return `value` over `std`: infinite for what is known exactly, zero where a deviation could not be had."""
    known = np.divide(value, std, out=np.zeros_like(value), where=std > 0.0)
    return np.where(std == 0.0, np.inf, known)
