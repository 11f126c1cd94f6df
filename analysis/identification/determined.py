"""Modes that the data determine: a criterion that knows only noise finds modes in whatever no linear model explains."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from analysis.identification.response_fit import RationalFit
from analysis.identification.timefit import TimeFit

_AnyFit = TypeVar("_AnyFit", TimeFit, RationalFit)

SIGNIFICANT = 3.0
"""Standard deviations by which a mode's decay rate must differ from zero."""


def without_undetermined(fit: _AnyFit, orders: tuple[int, ...], again: Callable[[int], _AnyFit]) -> _AnyFit:
    """Return the fit with no mode that the data leave undetermined, fitted `again` with one fewer each time."""
    while fit.model.n_blocks > orders[0] and not _all_determined(fit):
        fit = again(fit.model.n_blocks - 1)
    return fit


def _all_determined(fit: TimeFit | RationalFit) -> bool:
    """Tell whether frequency and decay rate of every block stand out of their uncertainty; a rigid body has neither."""
    model = fit.model
    moving = model.omega_rad_s > 0.0
    frequency = model.omega_rad_s >= SIGNIFICANT * fit.omega_std_rad_s
    decay = model.sigma_1_s >= SIGNIFICANT * fit.sigma_std_1_s
    return bool(np.all((frequency & decay)[moving]))
