"""The units that channels may carry, each with its conversion to the coherent SI unit that a log stores."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from math import pi
from types import MappingProxyType

from sim_backend.errors import ConfigError


@dataclass(frozen=True)
class Unit:
    """One accepted unit: value in `si` = factor * value + offset."""

    symbol: str
    si: str
    factor: float = 1.0
    offset: float = 0.0


_PREFIXED = {
    "rad": {"m": 1e-3, "u": 1e-6, "n": 1e-9},
    "m": {"m": 1e-3, "u": 1e-6, "n": 1e-9},
    "s": {"m": 1e-3, "u": 1e-6},
    "V": {"k": 1e3, "m": 1e-3, "u": 1e-6},
    "A": {"m": 1e-3, "u": 1e-6},
    "N": {"k": 1e3, "m": 1e-3, "u": 1e-6},
    "N m": {"m": 1e-3, "u": 1e-6},
    "Hz": {"k": 1e3},
    "K": {"m": 1e-3},
    "W": {"m": 1e-3},
    "Pa": {"k": 1e3},
    "T": {"m": 1e-3},
    "rad/s": {"m": 1e-3, "u": 1e-6},
    "rad/s^2": {},
    "m/s": {"m": 1e-3, "u": 1e-6},
    "m/s^2": {"m": 1e-3},
    "kg": {},
    "ohm": {},
    "1": {},
}
_OTHERS = (
    Unit("deg", "rad", pi / 180.0),
    Unit("arcmin", "rad", pi / 10800.0),
    Unit("arcsec", "rad", pi / 648000.0),
    Unit("deg/s", "rad/s", pi / 180.0),
    Unit("rpm", "rad/s", pi / 30.0),
    Unit("degC", "K", 1.0, 273.15),
    Unit("g", "kg", 1e-3),
    Unit("%", "1", 1e-2),
)


def _table() -> dict[str, Unit]:
    table = {si: Unit(si, si) for si in _PREFIXED}
    for si, prefixes in _PREFIXED.items():
        table |= {prefix + si: Unit(prefix + si, si, factor) for prefix, factor in prefixes.items()}
    return table | {unit.symbol: unit for unit in _OTHERS}


UNITS = MappingProxyType(_table())

_COUNTS = frozenset(("count", "counts", "cts", "lsb", "tick", "ticks", "increment", "increments", "inc", "digits"))


def is_unit(text: str) -> bool:
    """Tell whether a text is the symbol of an accepted unit."""
    return _plain(text) in UNITS


def is_count(text: str) -> bool:
    """Tell whether a text names the counts of a converter or an encoder, which are of no physical unit."""
    return text.strip().lower() in _COUNTS


def unit_named(symbol: str) -> Unit:
    """Return the accepted unit with this symbol; the micro sign is read as `u`, a middle dot as a space.

    Raises ConfigError naming the nearest accepted units and all of them.
    """
    plain = _plain(symbol)
    if plain in UNITS:
        return UNITS[plain]
    near = difflib.get_close_matches(plain, UNITS, n=1)
    hint = f"did you mean '{near[0]}'? " if near else ""
    raise ConfigError(f"unknown unit '{symbol}': {hint}accepted are {', '.join(sorted(UNITS))}")


def _plain(symbol: str) -> str:
    return symbol.strip().replace("µ", "u").replace("μ", "u").replace("·", " ").replace("°C", "degC")
