"""Tables of docs/ that are made from committed results: what a page shows is what the files hold."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.pages import TABLES, robustness, scores
from benchmarks.pages.__main__ import main
from benchmarks.pages.marks import DOCS, RESULTS, Table, files_of, percent, with_table


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.name)
def test_the_page_holds_the_table_of_the_files_it_names(table: Table) -> None:
    page = table.page.read_text(encoding="utf-8")
    files = files_of(page, table)
    assert files and all(file.is_file() and file.parent == RESULTS for file in files)
    assert with_table(page, table, files) == page


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.name)
def test_a_number_changed_by_hand_is_found(table: Table) -> None:
    page = table.page.read_text(encoding="utf-8")
    files = files_of(page, table)
    row = table.make(files).splitlines()[2]
    digit = next(c for c in row if c.isdigit())
    changed = page.replace(row, row.replace(digit, str((int(digit) + 1) % 10)))
    assert changed != page and with_table(changed, table, files) == page


def test_every_page_with_a_mark_has_a_maker() -> None:
    marked = {path.name for path in TABLES[0].page.parent.rglob("*.md") if "<!-- BEGIN " in path.read_text("utf-8")}
    assert marked == {table.page.name for table in TABLES}


def test_the_command_makes_every_table_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = list(RESULTS.glob("robustness-*.json"))[:1]
    page = tmp_path / "page.md"
    page.write_text(f"# Page\n<!-- BEGIN robustness: {files[0].name} -->\nold\n<!-- END robustness -->\nmore\n")
    monkeypatch.setattr("benchmarks.pages.__main__.TABLES", (Table("robustness", page, robustness.table),))
    assert main() == 0
    written = page.read_text(encoding="utf-8")
    assert robustness.table(files) in written and "old" not in written and written.endswith("-->\nmore\n")


def test_a_page_without_a_place_for_the_table_is_refused() -> None:
    with pytest.raises(ValueError, match="put both where the table belongs"):
        with_table("# Page\n", TABLES[0], [])


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.125, "13"), (0.625, "63"), (0.003, "0.3"), (0.9961, "99.6"), (2e-19, "0"), (1.0, "100"), (0.0, "0")],
)
def test_shares_are_whole_percent_but_near_none_and_all(share: float, text: str) -> None:
    assert percent(share) == text


def scored(folder: Path, **changes: Any) -> Path:
    """Write a score with every measure of the page, each at 0.91 of 100 unless a change by name says else."""
    common = {"value": 0.91, "interval": [0.84, 0.96], "n": 100, "low": None, "high": None, "stated": None, "ok": None}
    common |= {"enough": True, "least": 1}
    measures = [{"name": row.measure, **common} for row in scores.ROWS]
    measures[0] |= {"low": 0.97}
    measures[-1] |= {"stated": 0.8, "ok": False}
    bins = [{"low": 0.5, "high": 0.9, "stated": 0.8, "n": 100, "right": 91}]
    found = {"version": "1 (commit abc)", "cases": [{}] * 3, "measures": measures, "reliability": bins} | changes
    file = folder / "score.json"
    file.write_text(json.dumps(found), encoding="utf-8")
    return file


def test_a_score_is_held_against_the_target_of_the_second_generator(tmp_path: Path) -> None:
    rows = scores.table([scored(tmp_path)]).splitlines()
    assert rows[2].endswith("| 91 of 100: 91 % (84–96) | ≥ 90 % |")
    assert rows[9].endswith(
        "| **91 of 100: 91 %** (84–96) | the interval contains 80.0 %, the mean stated probability (100 at 80.0 %) |"
    )
    assert "Scored were 3 cases by 1 (commit abc)" in rows[11]
    assert rows[13] == (
        "those of the second generator: 90 % in row 1 (the file states that of the first generator, 97 %) "
        "and 85 % in row 6 (the file states none)."
    )


def test_a_target_that_asks_for_more_cases_than_there_were_says_so(tmp_path: Path) -> None:
    file = scored(tmp_path)
    found = json.loads(file.read_text(encoding="utf-8"))
    found["measures"][2] |= {"high": 0.005, "enough": False, "least": 300}
    file.write_text(json.dumps(found), encoding="utf-8")
    rows = scores.table([file]).splitlines()
    assert rows[4].endswith("| ≤ 0.5 % of 300 cases or more |")
    assert not any("cases or more" in row for row in (*rows[:4], *rows[5:]))


def test_the_page_of_challenges_states_the_same_targets() -> None:
    text = (DOCS / "challenge.md").read_text(encoding="utf-8")
    named, twisted = (row.low for row in scores.ROWS if row.low is not None)
    (file,) = files_of(*next((t.page.read_text(encoding="utf-8"), t) for t in TABLES if t.name == "scores"))
    first = json.loads(file.read_text(encoding="utf-8"))["measures"][0]["low"]
    assert f"(≥ {percent(first)} %; of the second generator ≥ {percent(named)} %)" in text
    (line,) = (line for line in text.splitlines() if line.startswith("- twisted:"))
    assert line.endswith(f"(≥ {percent(twisted)} %)")


def test_only_one_score_with_every_measure_is_shown(tmp_path: Path) -> None:
    file = scored(tmp_path)
    with pytest.raises(ValueError, match="made of one file; 2 were given"):
        scores.table([file, file])
    with pytest.raises(ValueError, match="has no measure 'named correctly"):
        scores.table([scored(tmp_path, measures=[])])
    with pytest.raises(ValueError, match="at least one results file"):
        robustness.table([])
