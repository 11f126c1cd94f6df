"""The paper's numbers, read from `numbers.toml`: value, unit, label and tolerance of every row of every table."""

from __future__ import annotations

import functools
import math
from importlib import resources
from typing import Literal

import msgspec

from sim_backend.documents import toml_of
from sim_backend.errors import ConfigError

Label = Literal["input", "calibrated", "predicted"]

UNIT_SI: dict[str, float] = {
    "": 1.0,
    "µrad": 1e-6,
    "mrad": 1e-3,
    "µm": 1e-6,
    "nm": 1e-9,
    "ms": 1e-3,
    "%": 1e-2,
    "Hz": 1.0,
    "W": 1.0,
    "A": 1.0,
    "N": 1.0,
    "dB": 1.0,
    "°": math.pi / 180.0,
    "samples": 1.0,
    "cycles": 1.0,
    "N m": 1.0,
    "N m/mrad": 1e3,
    "N m/mrad^2": 1e6,
    "N m/mrad^3": 1e9,
    "N m/mrad^4": 1e12,
    "N m/mrad^5": 1e15,
}
"""SI value of one of each unit that stands in the tables (dB is a level and counts as itself)."""


class PaperNumber(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One printed number and how ours is to be held against it; see the head of `numbers.toml`."""

    key: str
    row: str
    unit: str
    label: Label
    tolerance: float
    why: str
    value: float | None = None
    bound: bool = False
    printed: str = ""
    requirement: float | None = None
    at_least: bool = False
    place: str = ""
    target: str = ""


class PaperTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One table of the paper, or the numbers of its text."""

    title: str
    note: str
    rows: tuple[PaperNumber, ...]

    def number(self, key: str) -> PaperNumber:
        """Return the number with this key; raises ConfigError when there is none."""
        for number in self.rows:
            if number.key == key:
                return number
        raise ConfigError(f"'{self.title}' has no row '{key}'; it has {', '.join(n.key for n in self.rows)}")

    def printed(self, key: str) -> float:
        """Return a value in the unit it is printed in; raises ConfigError when there is no such row, or none in it."""
        value = self.number(key).value
        if value is None:
            raise ConfigError(f"'{self.title}' prints no value in row '{key}'; use another row")
        return value

    def value(self, key: str) -> float:
        """Return a printed value in SI; raises ConfigError as `printed` does."""
        return self.printed(key) * UNIT_SI[self.number(key).unit]


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    table: dict[str, PaperTable]


def parse_numbers(text: str, where: str) -> dict[str, PaperTable]:
    """Return the tables in TOML text; `where` names it in errors.

    Raises ConfigError for broken TOML, unknown fields, a key used twice, an unknown unit, or a tolerance that is
    negative, not finite or without a reason.
    """
    try:
        tables = msgspec.convert(toml_of(text, where), _File).table
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {error}; see its head for what a row holds") from None
    for key, table in tables.items():
        keys = [n.key for n in table.rows]
        for number in table.rows:
            if keys.count(number.key) > 1 or number.unit not in UNIT_SI:
                raise ConfigError(
                    f"{where}: table {key}, row '{number.key}' in '{number.unit}': use each key once, and a unit of "
                    f"{', '.join(filter(None, UNIT_SI))}"
                )
            if not (0.0 <= number.tolerance < math.inf and number.why):
                raise ConfigError(
                    f"{where}: table {key}, row '{number.key}' has tolerance {number.tolerance}; state one of zero or "
                    "more, and why"
                )
    return tables


@functools.cache
def paper_tables() -> dict[str, PaperTable]:
    """Return the paper's tables by number; `text` holds what stands in no table."""
    resource = resources.files("analysis.paper") / "numbers.toml"
    return parse_numbers(resource.read_text(encoding="utf-8"), "analysis/paper/numbers.toml")
