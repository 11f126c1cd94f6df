"""A linear model from a frequency-response table, the format in which vibration labs keep their data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.identification.determined import without_undetermined
from analysis.identification.growing_poles import remarks_on_growth
from analysis.identification.identified import TABLE, Identification, fitted_by, identification
from analysis.identification.input_delay import mechanical
from analysis.identification.missed_response import remarks_on_misses
from analysis.identification.modal_parameters import Structure
from analysis.identification.rational import fit_rational
from analysis.identification.repeated_points import averaged
from analysis.identification.response_curves import ResponseCurve
from analysis.identification.response_fit import RationalFit
from analysis.identification.response_table import Table, read_table
from campaigns.progress import Report, unheard
from sim_backend.errors import ConfigError, DataError
from sim_backend.linear import ModalModel
from sim_backend.model import Port

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ORDERS = (1, 2, 3, 4, 5, 6)
_GENERAL, _MECHANICAL = Structure(delay=True), Structure("mechanical", feedthrough=False, delay=True)
RELATIVE_START = 1e-3
"""Relative error that the first fit assumes: only what it finds is used, as with swept sines."""

OVER = 10.0
"""Rate of the model over the highest frequency of the table, where none is given: its hold then costs 5 % there."""


def identify_table(
    path: Path,
    *,
    modes: int | None = None,
    rate_hz: float | None = None,
    level: float | None = None,
    name: str = "identified",
    report: Report = unheard,
) -> Identification:
    """Return the linear model of a frequency-response table, at its lowest level or at `level`.

    Every point is weighed by its size, and the model's residual is its uncertainty. Raises ConfigError for a level that
    the table does not have, DataError as `read_table`.
    """
    table = averaged(read_table(path), path).table
    keep = np.ones(table.frequency_hz.size, dtype=bool)
    if table.level is not None:
        wanted = float(np.min(table.level)) if level is None else level
        keep = np.isclose(table.level, wanted, rtol=1e-6)
        if not keep.any():
            there = ", ".join(f"{one:g}" for one in np.unique(table.level)[:10])
            raise ConfigError(f"{path} has no level {level:g}: it has {there}")
    elif level is not None:
        raise ConfigError(f"{path} has no level {level:g}: it has no column of levels; leave out --level")
    f, response = table.frequency_hz[keep], table.response[keep]
    if rate_hz is not None and rate_hz < 2.0 * f[-1]:
        raise ConfigError(f"rate is {rate_hz:g} Hz, the table ends at {f[-1]:g} Hz: give more than twice that")
    if f.size < 8:
        raise DataError(f"{path} has {f.size} lines at {_at_level(table, keep)}; eight are needed for one mode")
    fit = _fitted(f, response, (modes,) if modes else ORDERS, report)
    output, input_ = table.units
    found = identification(
        fitted_by(fit, None, fit.dof),
        (),
        [Port(name="input", unit=input_, dof="x")],
        [Port(name="output", unit=output, dof="x")],
        method=TABLE,
        name=name,
        rate_hz=rate_hz or OVER * float(f[-1]),
        source=f"fit to {path.name}",
    )
    unknown = np.full(f.size, np.nan)
    curve = ResponseCurve("output", "input", f, np.abs(response), np.angle(response), unknown, unknown)
    # the table is of no samples, and is compared without the hold that a simulation puts before the model
    missed = remarks_on_misses((curve,), lambda _: fit.model.frequency_response(f)[:, 0, 0])
    grows = remarks_on_growth(found.model, (curve,), continuous=True)
    return replace(found, response=(curve,), remarks=(*table.remarks, *grows, *found.remarks, *missed))


def _at_level(table: Table, keep: NDArray[np.bool_]) -> str:
    if table.level is None:
        return "its only level"
    return f"the level {table.level[keep][0]:g} of {np.unique(table.level).size}"


def _fitted(f: Array, response: ComplexArray, orders: tuple[int, ...], report: Report) -> RationalFit:
    usable = tuple(n for n in orders if 4 * n < f.size) or orders[:1]
    size2 = np.maximum(np.abs(response), 1e-9 * np.abs(response).max()) ** 2

    def fitted(
        choice: tuple[int, ...], relative2: float, form: Structure = _GENERAL, start: ModalModel | None = None
    ) -> RationalFit:
        variance = (relative2 * size2)[:, None, None]
        lines = response[:, None, None]
        return fit_rational(f, lines, choice, variance=variance, structure=form, start=start, report=report)

    missed = fitted(usable[-1:], RELATIVE_START**2).model.frequency_response(f)[:, 0, 0] - response
    relative2 = max(float(np.median(np.abs(missed) ** 2 / size2) / np.log(2.0)), 1e-16)
    fit = without_undetermined(fitted(usable, relative2), usable, lambda n, _: fitted((n,), relative2))
    # direct paths and rates that are read act like a delay: without them it is known a thousand times as well
    simple = fitted((fit.model.n_blocks,), relative2, _MECHANICAL, mechanical(fit.model))
    return replace(simple, dropped=fit.dropped) if simple.criterion < fit.criterion else fit
