"""A linear model from a table of frequency response, the form in which vibration labs keep their data."""

from __future__ import annotations

import re
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.identification.determined import without_undetermined
from analysis.identification.identified import Fitted, Identification, deviations, identification
from analysis.identification.modal_parameters import Structure
from analysis.identification.rational import fit_rational
from analysis.identification.response_curves import ResponseCurve
from analysis.identification.response_fit import RationalFit
from campaigns.importing.sources import Source, open_source
from campaigns.log.units import is_unit, unit_named
from campaigns.progress import Report, unheard
from sim_backend.errors import ConfigError, DataError
from sim_backend.model import Port

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ORDERS = (1, 2, 3, 4, 5, 6)
RELATIVE_START = 1e-3
"""Relative error that the first fit assumes: only what it finds is used, as with swept sines."""

OVER = 10.0
"""Rate of the model over the highest frequency of the table, where none is given: its hold then costs 5 % there."""

_COLUMNS = {
    "imaginary": re.compile(r"(?i)^im(ag(inary)?)?\b"),
    "real": re.compile(r"(?i)^re(al)?\b"),
    "frequency": re.compile(r"(?i)^f\b|^freq|^omega|^w\b|^hz\b"),
    "phase": re.compile(r"(?i)phase|^phi\b|^arg\b"),
    "level": re.compile(r"(?i)^level|^drive|^excitation"),
    "magnitude": re.compile(r"(?i)mag|gain|^abs\b|^\|.*\|"),
}
"""What a column is, by its name; the first that fits."""

_FACTORS = {"hz": 1.0, "khz": 1e3, "rad/s": 0.5 / np.pi, "rads": 0.5 / np.pi}


@dataclass(frozen=True)
class Table:
    """A response (n,) by rising frequency at each level of excitation, with the units of output and input, if told."""

    frequency_hz: Array
    response: ComplexArray
    level: Array | None
    units: tuple[str, str]


def read_table(path: Path) -> Table:
    """Return the table at `path`; its columns are found by name, units in names or below them.

    Raises DataError for a table without frequency, or without magnitude and phase or real and imaginary part.
    """
    with ExitStack() as closing:
        source = open_source(path, closing)
        names: dict[str, str] = {}
        for name in source.names():
            role = _role(name)
            if role in names:
                both = f"'{names[role]}' and '{name}'"
                raise DataError(f"{path} has two columns of {role}, {both}: keep one response a file")
            if role:
                names[role] = name
        if "frequency" not in names:
            there = ", ".join(source.names()) or "no names"
            raise DataError(f"{path} has no column of frequency: name it as in 'frequency (Hz)'; it has {there}")
        values = {role: _numbers(source, name) for role, name in names.items()}
        units = {role: source.unit(name) or _written(name) for role, name in names.items()}
    f = values["frequency"] * _per_hz(names["frequency"], units["frequency"], path)
    if np.any(f < 0.0):
        raise DataError(f"{path}: a frequency is {f.min():g} Hz; give none below zero")
    if {"real", "imaginary"} <= set(values):
        response, unit = values["real"] + 1j * values["imaginary"], units["real"]
    elif {"magnitude", "phase"} <= set(values):
        size, unit = values["magnitude"], units["magnitude"]
        if unit.lower().startswith("db"):
            size, unit = 10.0 ** (size / 20.0), ""
        elif np.any(size < 0.0):
            raise DataError(f"{path}: a magnitude is {size.min():g}; name the column 'magnitude (dB)' if it is a level")
        response = size * np.exp(1j * _radians(values["phase"], units["phase"], path))
    else:
        raise DataError(f"{path} needs columns of magnitude and phase, or of real and imaginary part; it has {names}")
    over, under, factor = _units(unit, path)
    response = response * factor
    order = np.lexsort((f, values.get("level", np.zeros(f.size))))
    level = values["level"][order] if "level" in values else None
    return Table(f[order], response[order].astype(np.complex128), level, (over, under))


def _role(name: str) -> str | None:
    return next((role for role, pattern in _COLUMNS.items() if pattern.search(name)), None)


def _numbers(source: Source, name: str) -> Array:
    values = source.array(name)
    assert values is not None  # the source has just named it
    return np.asarray(values, dtype=np.float64)


def _radians(phase: Array, unit: str, path: Path) -> Array:
    if unit in ("deg", "°", "degree", "degrees"):
        return np.radians(phase)
    if unit == "rad":
        return phase
    if unit:
        raise DataError(f"{path}: phase is in '{unit}'; give deg or rad")
    if np.abs(phase).max(initial=0.0) > 4.0 * np.pi:
        return np.radians(phase)
    raise DataError(f"{path}: nothing says whether the phase is in degrees or rad: name it as in 'phase (deg)'")


def _written(name: str) -> str:
    """Return the unit that a name ends with without brackets: `phase_deg`, `mag dB`, `freq_khz`."""
    last = re.split(r"[_\s,]+", name.strip())[-1]
    return last if last.lower() in {*_FACTORS, "db", "deg", "rad", "degrees"} else ""


def _per_hz(name: str, unit: str, path: Path) -> float:
    """Return how many Hz the frequency's unit is; one that is called omega has a say in it."""
    if unit.lower() in _FACTORS:
        return _FACTORS[unit.lower()]
    if unit or re.match(r"(?i)omega|w\b", name):
        raise DataError(f"{path}: frequency is in '{unit or 'nothing that is said'}'; give Hz, kHz or rad/s")
    return 1.0


def _units(text: str, path: Path) -> tuple[str, str, float]:
    """Return the SI units of output and input of `m/N` or `rad per N m`, 1 where nothing is said, and the factor."""
    if not text or text == "1":
        return "1", "1", 1.0
    over, _, under = text.partition(" per ") if " per " in text else text.rpartition("/")
    if not (is_unit(over) and is_unit(under)):
        raise DataError(f"{path}: the response is in '{text}'; give output per input in known units, as in m/N")
    output, input_ = unit_named(over), unit_named(under)
    return output.si, input_.si, output.factor / input_.factor


def identify_table(
    path: Path,
    *,
    modes: int | None = None,
    rate_hz: float | None = None,
    level: float | None = None,
    name: str = "identified",
    report: Report = unheard,
) -> Identification:
    """Return the linear model of a table of frequency response, at its lowest level or at `level`.

    Every line is weighed by its size, and what the model misses of it is its uncertainty. Raises ConfigError for a
    level that the table does not have, DataError as `read_table`.
    """
    table = read_table(path)
    keep = np.ones(table.frequency_hz.size, dtype=bool)
    if table.level is not None:
        wanted = float(np.min(table.level)) if level is None else level
        keep = np.isclose(table.level, wanted, rtol=1e-6)
        if not keep.any():
            there = ", ".join(f"{one:g}" for one in np.unique(table.level)[:10])
            raise ConfigError(f"{path} has no level {level:g}: it has {there}")
    f, first = np.unique(table.frequency_hz[keep], return_index=True)
    response = table.response[keep][first]
    if rate_hz is not None and rate_hz < 2.0 * f[-1]:
        raise ConfigError(f"rate is {rate_hz:g} Hz, the table ends at {f[-1]:g} Hz: give more than twice that")
    if f.size < 8:
        raise DataError(f"{path} has {f.size} lines at this level; eight are needed for one mode")
    fit = _fitted(f, response, (modes,) if modes else ORDERS, report)
    output, input_ = table.units
    found = identification(
        Fitted(fit.model, deviations(fit), None, fit.dof),
        (),
        [Port(name="input", unit=input_, dof="x")],
        [Port(name="output", unit=output, dof="x")],
        method="table of frequency response",
        name=name,
        rate_hz=rate_hz or OVER * float(f[-1]),
        source=f"fit to {path.name}",
    )
    unknown = np.full(f.size, np.nan)
    curve = ResponseCurve("output", "input", f, np.abs(response), np.angle(response), unknown, unknown)
    return replace(found, response=(curve,))


def _fitted(f: Array, response: ComplexArray, orders: tuple[int, ...], report: Report) -> RationalFit:
    usable = tuple(n for n in orders if 4 * n < f.size) or orders[:1]
    size2 = np.maximum(np.abs(response), 1e-9 * np.abs(response).max()) ** 2

    def fitted(choice: tuple[int, ...], relative2: float) -> RationalFit:
        variance = (relative2 * size2)[:, None, None]
        structure = Structure(delay=True)
        return fit_rational(f, response[:, None, None], choice, variance=variance, structure=structure, report=report)

    missed = fitted(usable[-1:], RELATIVE_START**2).model.frequency_response(f)[:, 0, 0] - response
    relative2 = max(float(np.median(np.abs(missed) ** 2 / size2) / np.log(2.0)), 1e-16)
    return without_undetermined(fitted(usable, relative2), usable, lambda n, _: fitted((n,), relative2))
