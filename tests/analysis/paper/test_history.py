"""A tolerance or a label that is not what it was at first has an entry that says when it changed, and why."""

import tomllib
from datetime import date
from fnmatch import fnmatchcase
from pathlib import Path

import pytest

from analysis.paper.numbers import paper_tables

FIRST = tomllib.loads(Path(__file__).with_name("first_tolerances.toml").read_text(encoding="utf-8"))
NOW = {(key, n.key): (n.label, n.tolerance) for key, table in paper_tables().items() for n in table.rows}
CHANGES = tomllib.loads(Path(__file__).with_name("changes.toml").read_text(encoding="utf-8"))


def followed(what, of, read):
    """What the entries make of the first list; every entry must continue what stood before it."""
    now = {(table, key): row[of] for table, rows in FIRST.items() for key, row in rows.items()}
    for _, table, pattern, was, becomes, _ in CHANGES[what]:
        rows = [row for row in now if row[0] == table and fnmatchcase(row[1], pattern)]
        assert rows, f"no row {pattern} in table {table}"
        for row in rows:
            assert now[row] == read(was), f"{row}: {now[row]}, and the entry says {was}"
            assert read(becomes) != read(was)
            now[row] = read(becomes)
    return now


def test_every_row_has_its_first_label_and_tolerance_on_record():
    assert {(table, key) for table, rows in FIRST.items() for key in rows} == set(NOW)


@pytest.mark.parametrize(("what", "of", "read"), [("tolerance", 1, float), ("label", 0, str)])
def test_whatever_changed_has_an_entry_and_nothing_else_has(what, of, read):
    made = followed(what, of, read)
    assert {row: (value, NOW[row][of]) for row, value in made.items() if value != NOW[row][of]} == {}


@pytest.mark.parametrize("what", ["tolerance", "label"])
def test_every_entry_says_when_and_why(what):
    found = CHANGES[what]
    days = [date.fromisoformat(when) for when, *_ in found]
    assert len(found) > 10 and days == sorted(days)
    assert all(len(why.split()) > 4 for *_, why in found)
