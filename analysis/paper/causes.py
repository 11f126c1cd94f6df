"""Why the bundled bench misses a printed number, where that is known; `causes.toml` holds the sentences."""

from __future__ import annotations

import functools
from fnmatch import fnmatchcase
from importlib import resources

import msgspec

from analysis.paper.numbers import paper_tables
from sim_backend.documents import toml_of
from sim_backend.errors import ConfigError

WORDS = "analysis/paper/causes.toml"

NOT_EXPLAINED = "not explained"


class _Cause(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    text: str
    rows: tuple[tuple[str, str], ...]


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    cause: tuple[_Cause, ...]


def parse_causes(text: str, where: str) -> dict[tuple[str, str], str]:
    """Return the cause of every row that has one, by table and key; `where` names the text in errors.

    Raises ConfigError for a pattern without a row and for a row with two causes.
    """
    keys = [(table, number.key) for table, paper in paper_tables().items() for number in paper.rows]
    found: dict[tuple[str, str], str] = {}
    for cause in msgspec.convert(toml_of(text, where), _File).cause:
        for table, pattern in cause.rows:
            rows = [row for row in keys if row[0] == table and fnmatchcase(row[1], pattern)]
            if not rows or any(row in found for row in rows):
                wrong = "matches a row that has a cause" if rows else "matches no row"
                raise ConfigError(f"{where}: '{pattern}' of table {table} {wrong}; name each row of numbers.toml once")
            found.update(dict.fromkeys(rows, cause.text))
    return found


@functools.cache
def _bundled() -> dict[tuple[str, str], str]:
    resource = resources.files("analysis.paper") / "causes.toml"
    return parse_causes(resource.read_text(encoding="utf-8"), WORDS)


def cause_of(table: str, key: str) -> str:
    """Return why the bundled bench misses a row, or that it is not explained."""
    return _bundled().get((table, key), NOT_EXPLAINED)
