"""Tables of frequency response as laboratories write them: columns found by name, units in names or below them."""

from __future__ import annotations

import re
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from campaigns.importing.sources import Source, open_source
from campaigns.log.units import is_unit, unit_named
from sim_backend.errors import DataError
from sim_backend.readings import LEAST, MOST

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_COLUMNS = {
    "coherence": re.compile(r"(?i)coheren|^coh\b|^gamma"),
    "std": re.compile(r"(?i)^std|^sd\b|^sigma|^(standard )?deviation|^uncertainty"),
    "imaginary": re.compile(r"(?i)^im(ag(inary)?)?\b"),
    "real": re.compile(r"(?i)^re(al)?\b"),
    "frequency": re.compile(r"(?i)^f\b|^freq|^omega|^w\b|^hz\b"),
    "phase": re.compile(r"(?i)phase|^phi\b|^arg\b"),
    "level": re.compile(r"(?i)^level|^drive|^excitation"),
    "magnitude": re.compile(r"(?i)mag|gain|^abs\b|^\|.*\||^ampl(itude)?[ _]ratio"),
    "amplitude": re.compile(r"(?i)^(input[ _])?ampl(itude)?(?![a-z])"),
}
"""What a column is, by its name; the first that fits. An amplitude is the level beside a magnitude."""

_FACTORS = {"hz": 1.0, "khz": 1e3, "rad/s": 0.5 / np.pi, "rads": 0.5 / np.pi}


_MOST_STEP = 1.01 * np.pi
"""Radians by which an unwrapped phase steps from line to line at most, but for rounding."""

_FLAT = 10.0
"""Least ratio of sizes of a response whose phase cannot stay within three degrees (Bode's relation of the two)."""


@dataclass(frozen=True)
class Table:
    """A response (n,) by rising frequency at each level of excitation, with the units of output and input, if stated.

    `std` (n,) is the standard deviation of the magnitude, in its unit, and over it that of the phase in rad;
    `coherence` (n,) is the ordinary one, 0 to 1. Both are None where the table has no such column. `unnamed` are the
    numbers (n,) of columns whose names say nothing. `remarks` say what was left out.
    """

    frequency_hz: Array
    response: ComplexArray
    level: Array | None
    units: tuple[str, str]
    level_unit: str = ""
    std: Array | None = None
    coherence: Array | None = None
    unnamed: dict[str, Array] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


def read_table(path: Path) -> Table:
    """Return the table at `path`; its columns are found by name, units in names or below them.

    Raises DataError for a table without frequency, without magnitude and phase or real and imaginary part, or whose
    numbers cannot be what their columns say.
    """
    names, values, units, unnamed = _read_columns(path)
    f = values["frequency"] * _per_hz(names["frequency"], units["frequency"], path)
    if np.any(f < 0.0):
        raise DataError(f"{path}: a frequency is {np.nanmin(f):g} Hz; give none below zero")
    response, unit = _response(path, names, values, units)
    over, under, factor = _units(unit, path)
    response = response * factor
    _require_computable(path, {"frequency": f, "response": np.abs(response), "level": values.get("level", f)})
    keep, remarks = _usable(path, f, response, values)
    order = np.flatnonzero(keep)[np.lexsort((f[keep], values.get("level", np.zeros(f.size))[keep]))]
    std, coherence = _spread(path, values, factor, units, keep)
    return Table(
        f[order],
        response[order].astype(np.complex128),
        values["level"][order] if "level" in values else None,
        (over, under),
        units.get("level", ""),
        None if std is None else std[order],
        None if coherence is None else coherence[order],
        {name: numbers[order] for name, numbers in unnamed.items()},
        remarks,
    )


def _read_columns(path: Path) -> tuple[dict[str, str], dict[str, Array], dict[str, str], dict[str, Array]]:
    """Return name, numbers (n,) and unit of every column that has a role, and the numbers of all others."""
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
        _amplitude_as_level(path, names)
        values = {role: _numbers(source, name) for role, name in names.items()}
        units = {role: source.unit(name) or _written(name) for role, name in names.items()}
        others = {name: _numbers_if_any(source, name) for name in source.names() if name not in names.values()}
    size = values["frequency"].size
    unnamed = {name: numbers for name, numbers in others.items() if numbers is not None and numbers.shape == (size,)}
    return names, values, units, unnamed


def _amplitude_as_level(path: Path, names: dict[str, str]) -> None:
    """Make the amplitude the level, in place, beside a magnitude; raise DataError where it may be the magnitude."""
    name = names.pop("amplitude", None)
    if name is None:
        return
    if "magnitude" not in names:
        raise DataError(
            f"{path}: '{name}' may be the magnitude of the response or the level of excitation: name it "
            "'magnitude (unit)' or 'level (unit)'"
        )
    if "level" not in names:
        names["level"] = name


def _response(
    path: Path, names: dict[str, str], values: dict[str, Array], units: dict[str, str]
) -> tuple[ComplexArray, str]:
    """Return the response (n,) in the unit that is returned with it."""
    if {"real", "imaginary"} <= set(values):
        return values["real"] + 1j * values["imaginary"], units["real"]
    if not {"magnitude", "phase"} <= set(values):
        raise DataError(f"{path} needs columns of magnitude and phase, or of real and imaginary part; it has {names}")
    size, unit = values["magnitude"], units["magnitude"]
    if unit.lower().startswith("db"):
        size, unit = 10.0 ** (size / 20.0), ""
    elif np.any(size < 0.0):
        raise DataError(
            f"{path}: a magnitude is {np.nanmin(size):g}; name the column 'magnitude (dB)' if it is a level"
        )
    phase = _radians(values["phase"], units["phase"], path)
    order = np.lexsort((values["frequency"], values.get("level", np.zeros(phase.size))))
    _require_possible(path, values["phase"][order], phase[order], size[order])
    return size * np.exp(1j * phase), unit


def _require_computable(path: Path, columns: dict[str, Array]) -> None:
    """Raise DataError for a number (n,) too large for any bench, whose square may overflow; infinite ones are kept."""
    for name, values in columns.items():
        size = np.abs(values)
        wrong = np.flatnonzero(np.isfinite(size) & ((size > MOST) | ((size > 0.0) & (size < LEAST))))
        if wrong.size:
            raise DataError(
                f"{path}: row {wrong[0] + 1} has a {name} of {values[wrong[0]]:.3g} in SI units; no bench has more "
                f"than {MOST:g} or, but for zero, less than {LEAST:g}: correct the number or its unit"
            )


def _require_possible(path: Path, written: Array, phase_rad: Array, size: Array) -> None:
    """Raise DataError where degrees stand for rad or rad for degrees; all (n,) by rising frequency.

    A phase is wrapped, within ±2π, or unwrapped, with steps of at most π. And what stays within three degrees of zero
    or half a turn keeps its size: Bode, Network Analysis and Feedback Amplifier Design (1945), chapter 14.
    """
    known = np.isfinite(written) & np.isfinite(size) & (size > 0.0)
    if np.count_nonzero(known) < 2:
        return
    written, phase_rad, size = written[known], phase_rad[known], size[known]
    in_rad = np.array_equal(written, phase_rad)
    largest, step = float(np.abs(written).max()), float(np.abs(np.diff(written)).max())
    if in_rad and largest > 2.0 * _MOST_STEP and step > _MOST_STEP:
        raise DataError(
            f"{path}: the phase in rad goes to {largest:.4g} and steps by {step:.4g} between lines, neither "
            "wrapped nor unwrapped: name the column 'phase (deg)' if these are degrees"
        )
    if not in_rad and 0.0 < largest <= _MOST_STEP and size.max() > _FLAT * size.min():
        raise DataError(
            f"{path}: the phase stays within {largest:.3g} degrees while the magnitude changes by a factor of "
            f"{size.max() / size.min():.3g}: name the column 'phase (rad)' if these are rad, or give real and "
            "imaginary part"
        )


def _usable(path: Path, f: Array, response: ComplexArray, values: dict[str, Array]) -> tuple[Any, tuple[str, ...]]:
    """Return which rows (n,) hold a frequency and a response, and what was left out; at least one must."""
    keep = np.isfinite(f) & np.isfinite(response) & np.isfinite(values.get("level", f))
    if not keep.any():
        raise DataError(f"{path} holds no line in which frequency and response are numbers ({f.size} rows)")
    left = int(np.count_nonzero(~keep))
    return keep, (f"{left} of {f.size} rows of {path.name} hold no numbers and are left out",) if left else ()


def _spread(
    path: Path, values: dict[str, Array], factor: float, units: dict[str, str], keep: Any
) -> tuple[Array | None, Array | None]:
    """Return standard deviation (the magnitude's unit) and coherence, each (n,) or None where not all is stated."""
    std, coherence = values.get("std"), values.get("coherence")
    if std is not None:
        if units.get("std", "").lower().startswith("db") or units.get("magnitude", "").lower().startswith("db"):
            raise DataError(f"{path}: a deviation in dB is not read; give magnitude and its deviation in one unit")
        _require_within(path, "standard deviation", std, keep & (std <= 0.0), values, "it must be above zero")
        std = std * factor if np.isfinite(std[keep]).all() else None
    if coherence is not None:
        outside = keep & ((coherence < 0.0) | (coherence > 1.0))
        _require_within(path, "coherence", coherence, outside, values, "it lies between 0 and 1")
        coherence = coherence if np.isfinite(coherence[keep]).all() else None
    return std, coherence


def _require_within(path: Path, what: str, column: Array, wrong: Any, values: dict[str, Array], limit: str) -> None:
    """Raise DataError for the first row (n,) that is `wrong`, with its frequency as the file has it."""
    for row in np.flatnonzero(wrong)[:1]:
        raise DataError(
            f"{path}: row {row + 1}, at the frequency {values['frequency'][row]:g}, has a {what} of {column[row]:g}; "
            f"{limit}: correct the number, or leave out the column"
        )


def _role(name: str) -> str | None:
    words = name.replace("_", " ")  # as in `f_Hz`
    return next((role for role, pattern in _COLUMNS.items() if pattern.search(words)), None)


def _numbers(source: Source, name: str) -> Array:
    values = source.array(name)
    assert values is not None  # the source has just named it
    return np.asarray(values, dtype=np.float64)


def _numbers_if_any(source: Source, name: str) -> Array | None:
    """Return the numbers of a column; None where it holds something else."""
    try:
        return _numbers(source, name)
    except (DataError, ValueError, TypeError):
        return None


def _radians(phase: Array, unit: str, path: Path) -> Array:
    if unit in ("deg", "°", "degree", "degrees"):
        return np.radians(phase)
    if unit == "rad":
        return phase
    if unit:
        raise DataError(f"{path}: phase is in '{unit}'; give deg or rad")
    if np.nanmax(np.abs(phase), initial=0.0) > 4.0 * np.pi:
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
