"""The paper's numbers, read from `numbers.toml`: value, unit, label and tolerance of every row of every table."""

from __future__ import annotations

import functools
import math
from importlib import resources
from typing import Literal

import msgspec

from analysis.paper.tolerances import RULES, WIDEST, Case, tolerance_of, why_of
from sim_backend.documents import toml_of
from sim_backend.errors import ConfigError

Label = Literal["predicted", "calibrated", "input", "bound"]
"""What a row's agreement is worth; see the head of `numbers.toml`."""

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
    "mrad/N m": 1e-3,
    "mm/N": 1e-3,
}
"""SI value of one of each unit in the tables (dB is a level and counts as itself)."""


class PaperNumber(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One printed number and how ours is compared with it; see the head of `numbers.toml`.

    `tolerance` (in `unit`) and its reason `why` follow from the `rule`.
    """

    key: str
    row: str
    unit: str
    label: Label
    tolerance: float = math.nan
    why: str = ""
    rule: str = ""
    given: dict[str, float | str] = {}
    value: float | None = None
    upper: bool = False
    printed: str = ""
    requirement: float | None = None
    at_least: bool = False
    place: str = ""
    target: str = ""
    chosen: str = ""
    seen: str = ""
    repeats: tuple[str, str] | None = None

    @property
    def digits(self) -> str:
        """The value's digits as printed."""
        return self.printed or f"{self.value or 0.0:.10g}"


class PaperTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One table of the paper, or the numbers of its text."""

    title: str
    note: str
    rows: tuple[PaperNumber, ...]
    folded: bool = False

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

    Raises ConfigError for broken TOML, unknown fields, a key used twice, an unknown unit or rule, a calibrated row
    without its history, a predicted row that could hardly fail, and one that repeats a row that is not there.
    """
    try:
        tables = msgspec.convert(toml_of(text, where), _File).table
    except msgspec.ValidationError as error:
        raise ConfigError(f"{where}: {error}; see its head for what a row holds") from None
    keys = {(key, n.key) for key, table in tables.items() for n in table.rows}
    for n in (n for table in tables.values() for n in table.rows):
        if n.repeats and n.repeats not in keys:
            raise ConfigError(
                f"{where}: row '{n.key}' repeats {list(n.repeats)}, which does not exist; name table and key"
            )
    return {
        key: msgspec.structs.replace(
            table, rows=tuple(_complete(n, table, f"{where}: table {key}") for n in table.rows)
        )
        for key, table in tables.items()
    }


def _complete(number: PaperNumber, table: PaperTable, where: str) -> PaperNumber:
    """Return a row with its tolerance and the reason; raises ConfigError as `parse_numbers`."""
    here = f"{where}, row '{number.key}'"
    if sum(n.key == number.key for n in table.rows) > 1 or number.unit not in UNIT_SI:
        raise ConfigError(
            f"{here} in '{number.unit}': use each key once, and a unit of {', '.join(filter(None, UNIT_SI))}"
        )
    complete = _with_tolerance(number, table, here)
    if number.label == "calibrated" and not (number.target and number.chosen and number.seen):
        raise ConfigError(
            f"{here} is calibrated; state its target, the day it was chosen and the alternatives that were seen"
        )
    if number.label == "predicted" and not _could_fail(complete):
        above = " above an upper bound" if number.upper else ""
        raise ConfigError(
            f"{here} is predicted with tolerance {complete.tolerance:g}{above}; "
            f"a prediction is not an upper bound and has at most {WIDEST:g} of its value: label it 'bound'"
        )
    return complete


def _with_tolerance(number: PaperNumber, table: PaperTable, here: str) -> PaperNumber:
    if number.rule not in RULES or number.why:
        raise ConfigError(f"{here} has rule '{number.rule}'; name one of {', '.join(RULES)}, which gives the reason")
    values = {n.key: n.value for n in table.rows if n.value is not None}
    case = Case(number.value or 0.0, number.digits, number.given, values)
    try:
        made, why = tolerance_of(number.rule, case), why_of(number.rule, number.given)
    except KeyError as error:
        raise ConfigError(f"{here}: rule '{number.rule}' needs {error} in 'given'") from None
    stored = not math.isnan(number.tolerance)
    if (made is None) != stored or (stored and not 0.0 <= number.tolerance < math.inf):
        raise ConfigError(
            f"{here} has tolerance {number.tolerance:g} by rule '{number.rule}'; state one, of zero or more, only for "
            "a rule that stores it"
        )
    return msgspec.structs.replace(number, tolerance=number.tolerance if made is None else made, why=why)


def _could_fail(number: PaperNumber) -> bool:
    return not number.upper and number.tolerance <= WIDEST * abs(number.value or 0.0)


@functools.cache
def paper_tables() -> dict[str, PaperTable]:
    """Return the paper's tables by number; `text` holds the numbers outside of the tables."""
    resource = resources.files("analysis.paper") / "numbers.toml"
    return parse_numbers(resource.read_text(encoding="utf-8"), "analysis/paper/numbers.toml")
