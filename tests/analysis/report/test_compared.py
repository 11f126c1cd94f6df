"""A table that compares: this project's numbers beside the paper's controllers, in every form of the table."""

import re

import pandas as pd

from analysis.paper.numbers import PaperNumber, PaperTable
from analysis.paper.rows import Ours, build_table
from analysis.report.page import render_page, render_table
from analysis.report.tables import display_frame, latex, write_table
from analysis.report.verdict import verdict_of

ROWS = tuple(
    PaperNumber(
        key=key,
        row=f"row {key}",
        unit=unit,
        label="predicted",
        tolerance=0.4,
        why="rounding",
        value=5.6,
        requirement=limit,
    )
    for key, unit, limit in (("fast", "ms", 5.0), ("still", "µrad", 1.7), ("cool", "W", 1.0))
)
PAPER = PaperTable(title="Performance", note="", rows=ROWS)
THEIRS = {"fast": Ours(5.5e-3), "still": Ours(2.0e-6), "cool": Ours(0.2)}
OWN = {"fast": Ours(4.5e-3, 1e-4), "still": Ours(1.8e-6)}


def test_own_numbers_are_judged_apart_and_change_no_agreement():
    table = build_table("6.6", PAPER, THEIRS, (), OWN)
    alone = build_table("6.6", PAPER, THEIRS)
    assert [r.ok for r in table.rows] == [r.ok for r in alone.rows] == [True, False, False]
    assert [r.own_met for r in table.rows] == [True, False, None]
    assert table.compared and not alone.compared
    found = verdict_of({"6.6": table})
    assert (found.met, found.measured) == (1, 3)
    assert (found.own_met, found.own_measured, found.own_missed) == (1, 2, ("row still",))


def test_every_form_of_the_table_shows_both(tmp_path):
    table = build_table("6.6", PAPER, THEIRS, (), OWN)
    write_table(table, tmp_path, render_table(table))
    frame = pd.read_csv(tmp_path / "table-6.6.csv")
    assert frame.this_project.tolist()[:2] == [4.5, 1.8] and frame.this_project.isna().tolist() == [False, False, True]
    shown = display_frame(table)
    assert shown["this project"].tolist() == ["4.50", "1.8", "—"]
    # what is hidden stands beside the name of its row on a telephone
    html, hidden = re.subn(r"<(small|span)[^>]* hidden>[^<]*</\1>", "", render_table(table))
    assert hidden == 3 + 2 + 2  # three of theirs, two of ours, each of these named
    assert html.count("this project") == 1 and "paper&#39;s controllers here" in html.replace("'", "&#39;")
    assert html.count(">missed<") == 3 and html.count(">met<") == 2
    assert "this project" in latex(table) and "paper's controllers here" in latex(table)
    assert [row["this_project"] for row in table.as_json()] == [4.5, 1.8, None]


def test_without_a_design_a_table_is_as_it_was():
    table = build_table("6.6", PAPER, THEIRS)
    assert "this project" not in render_table(table) and "this project" not in display_frame(table)
    assert "this_project" not in table.frame() and "this_project" not in table.as_json()[0]
    assert "This project's controller meets" not in render_page([], {"6.6": table}, {}, [])
