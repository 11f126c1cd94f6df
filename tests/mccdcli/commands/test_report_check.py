"""The JUnit file of `mccd report --check` names what fails as a list of known misses has to."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import cast
from xml.etree import ElementTree

from analysis.paper.known_misses import load_known_misses
from analysis.paper.numbers import paper_tables
from analysis.paper.rows import build_table
from analysis.report.build import Report
from mccdcli.commands.report import _checked


def test_a_failed_case_is_known_once_its_name_is_in_the_list(tmp_path: Path) -> None:
    # a campaign that measured nothing: every number that can fail is a case
    tables = {key: build_table(key, paper, {}, ()) for key, paper in paper_tables().items()}
    junit = tmp_path / "report.xml"
    _checked(cast(Report, SimpleNamespace(tables=tables)), {}, junit)
    cases = list(ElementTree.parse(junit).getroot().iter("testcase"))
    names = [case.get("name", "") for case in cases]
    assert names and len(names) == len(set(names))
    # a reader makes groups of what dots separate: the name of a table stays whole
    assert {case.get("classname") for case in cases} == {"mccd report"}
    places = [tuple(name.split(": ", 1)) for name in names]
    known = tmp_path / "known.toml"
    lines = []
    for table, rows in groupby(places, key=lambda place: place[0]):
        lines += [f"[{_quoted(table)}]", *(f'{_quoted(row)} = "reviewed"' for _, row in rows)]
    known.write_text("\n".join(lines), encoding="utf-8")
    assert list(load_known_misses(known)) == places


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '\\"') + '"'
