"""Committed results of the speed benchmarks: complete, consistent with themselves, and what the page shows of them."""

from __future__ import annotations

import json
import re
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from benchmarks.__main__ import SPEED, main
from benchmarks.pages.marks import RESULTS, Table, files_of
from benchmarks.speed.page import table
from benchmarks.speed.report import SCHEMA, markdown

FILES = sorted(RESULTS.glob("speed-*.json"))
OLD = "mccd-speed/1"
"""Of results that do not tell the load, the compiler and the state of the sources by fields of their own."""
VERSIONS = ("python", "gcc", "numpy", "scipy", "numba")


def read(file: Path) -> dict[str, Any]:
    return json.loads(file.read_text(encoding="utf-8"))


def test_there_are_results() -> None:
    assert FILES


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_results_say_what_they_were_measured_with(file: Path) -> None:
    found = read(file)
    assert found["schema"] in (OLD, SCHEMA) and found["quick"] is False
    begun = datetime.fromisoformat(found["started_utc"])
    assert begun.tzinfo is not None and file.stem.endswith(f"{begun:-%Y-%m-%d}")
    assert found["command"].startswith("python -m benchmarks")
    if found["schema"] == OLD:
        assert re.search(r"\(commit [0-9a-f]{7,}(-dirty)?\)$", found["mccd"])
        assert re.search(r", \d+ cores; Python 3\.\d+\.\d+, numpy .+, scipy .+, numba .+", found["machine"])
        return
    assert set(found["mccd"]) == {"version", "commit", "dirty"}
    assert found["mccd"]["dirty"] is None or re.fullmatch("[0-9a-f]{7,}", found["mccd"]["commit"])
    assert found["machine"]["cores"] > 0 and found["machine"]["processor"]
    assert all(found["machine"][name] for name in VERSIONS)
    assert datetime.fromisoformat(found["ended_utc"]) >= begun
    assert set(found["load"]) == {"start", "end"}
    assert all(values is None or len(values) == 3 for values in found["load"].values())


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_results_hold_measured_values_that_agree_with_what_is_said_of_them(file: Path) -> None:
    found = read(file)
    assert found["benchmarks"]
    for row in found["benchmarks"]:
        assert row["targets"] and row["contenders"] and all(a["holds"] for a in row["agreements"])
        for told in row["contenders"].values():
            spread = told["seconds_per_unit"]
            assert 0.0 < spread["lowest"] <= spread["median"] <= spread["highest"] and spread["rounds"] >= 1
        for target in row["targets"]:
            assert target["what"] and target["unit"] and target["limit"] > 0.0
            if target["reached"] is None:
                assert target["why"] and "median" not in target
                continue
            assert target["lowest"] <= target["median"] <= target["highest"] and target["rounds"] >= 1
            far = target["median"] - target["limit"]
            assert target["reached"] is (far <= 0.0 if target["at_most"] else far >= 0.0)
            if not target["reached"]:
                assert target["why"] and len(row["profiles"][target["of"]]) > 1


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_the_table_beside_results_is_theirs(file: Path) -> None:
    found, page = read(file), file.with_suffix(".md").read_text(encoding="utf-8")
    if found["schema"] == SCHEMA:
        assert page == markdown(found)
    assert all(
        f"| {row['name']} | {target['what']} |" in page for row in found["benchmarks"] for target in row["targets"]
    )


def test_the_page_opens_with_the_table_of_its_files() -> None:
    page = SPEED.page.read_text(encoding="utf-8")
    files = files_of(page, SPEED)
    assert files and set(files) <= set(FILES)
    shown = [line for line in page.splitlines() if line and not line.startswith("<!--")]
    assert shown[:2] == ["# Speed", table(files).splitlines()[0]]


def result(folder: Path, name: str, reached: bool | None, quick: bool = False, median: float = 2.0) -> Path:
    target = {"what": "a ÷ b", "limit": 1.5, "unit": "×", "at_most": True, "reached": reached}
    target |= {"median": median, "lowest": 1.0, "highest": 3.0}
    file = folder / f"speed-{name}.json"
    file.write_text(json.dumps({"quick": quick, "benchmarks": [{"name": "made-up", "targets": [target]}]}))
    return file


def test_the_table_tells_what_is_missed_and_leaves_out_what_is_not_measured(tmp_path: Path) -> None:
    missed, untold = result(tmp_path, "missed", False), result(tmp_path, "untold", None)
    (row,) = table([untold, missed]).splitlines()[2:]
    assert row == "| made-up: a ÷ b | ≤ 1.5 × | [2 (1 to 3)](../benchmarks/results/speed-missed.json), **missed** |"


def test_of_two_results_the_first_is_told(tmp_path: Path) -> None:
    first, second = result(tmp_path, "first", True, median=1.0), result(tmp_path, "second", False)
    (row,) = table([first, second]).splitlines()[2:]
    assert "speed-first.json" in row and "missed" not in row


def test_small_sizes_are_not_shown(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="small sizes"):
        table([result(tmp_path, "quick", True, quick=True)])


def test_the_command_writes_the_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "speed.md"
    page.write_text("# Speed\n<!-- BEGIN speed: x -->\nold\n<!-- END speed -->\nrest\n")
    monkeypatch.setattr("benchmarks.__main__.SPEED", Table("speed", page, table))
    assert main(["--page", str(FILES[0])]) == 0
    written = page.read_text(encoding="utf-8")
    assert table(FILES[:1]) in written and "old" not in written and written.endswith("-->\nrest\n")


def test_only_committed_results_go_into_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["--page", str(result(tmp_path, "elsewhere", True))])
    assert stopped.value.code == 2 and "the page links to them" in capsys.readouterr().err
