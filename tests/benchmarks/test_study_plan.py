"""The page of studies says what the committed measurements say, and its plan follows from them."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from benchmarks.study_plan import Cost, table, time_text

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks" / "results"
PAGE = max(FOLDER.glob("study-plan-*.md")).read_text(encoding="utf-8")
SUMMARY = (ROOT / "docs" / "studies.md").read_text(encoding="utf-8")


def named(prefix: str) -> dict[str, Any]:
    """Return the one result of a kind that the page names."""
    (name,) = set(re.findall(rf"benchmarks/results/({prefix}-[\d-]+\.json)", PAGE))
    return dict(json.loads((FOLDER / name).read_text(encoding="utf-8")))


def row(rows: list[dict[str, Any]], **wanted: object) -> dict[str, Any]:
    (found,) = [one for one in rows if all(one[name] == value for name, value in wanted.items())]
    return found


def test_the_page_names_the_newest_measurement() -> None:
    assert named("study-cost") == json.loads(max(FOLDER.glob("study-cost-*.json")).read_text(encoding="utf-8"))


@pytest.mark.parametrize("study", ["spread", "power"])
def test_the_page_holds_the_plan_that_the_formulas_give(study: str) -> None:
    assert table(named("study-cost"), study) in PAGE


@pytest.mark.parametrize("study", ["spread", "power"])
def test_the_plan_follows_from_keys_of_the_result(study: str) -> None:
    found = named("study-cost")
    alone = row(found["threads"], study=study, workers=1)["trials_per_s"]
    four = row(found["cluster"], study=study, workers=4)
    idle = [one for one in found["trials_that_do_nothing"] if one.get("engine", "cluster") == "cluster"]
    dispatch = max(one["trials_per_s"] for one in idle if one["workers"] == 4)
    million = row(found["book_keeping"], trials=1_000_000)
    written = table(found, study).splitlines()
    cells = {line.split(" | ")[0].lstrip("| "): [c.strip(" |") for c in line.split(" | ")[2:]] for line in written}
    rates = [four["trials_per_s"], min(10 * alone, dispatch), min(64 * alone, dispatch)]
    for column, rate in enumerate(rates):
        star = "*" if column else ""  # four workers were measured, ten and sixty-four were not
        assert cells["wall time"][column] == time_text(1e6 / rate) + star
        assert float(cells["trials per s"][column].removesuffix(star)) == pytest.approx(rate, rel=0.05)  # two digits
    for column, workers in enumerate((4, 10, 64)):
        memory, unit = cells["memory of the workers"][column].split(" ")
        assert unit == ("GB*" if column else "GB")
        assert float(memory) == pytest.approx(workers * four["worker_peak_mb"] / 1000.0, rel=0.05)
    size = million["bytes_per_trial"]
    assert float(cells["disk"][0].split(" ")[0]) == pytest.approx(
        (size["trials.sqlite"] + size["trials.csv"]) / 1000.0, rel=0.05
    )
    assert cells["summary and files"] == [time_text(million["conclude_s"])] * 3


def test_the_page_for_users_says_what_the_plan_says() -> None:
    spread, power = (
        [row.split(" | ")[2:4] for row in table(named("study-cost"), s).splitlines()] for s in ("spread", "power")
    )
    rate, wall, _, _, workers, _, disk, _ = (one[0] for one in spread[2:])
    rate_power, wall_power, _, _, workers_power, *_ = (one[0] for one in power[2:])
    said = " ".join(SUMMARY.split())
    assert f"finish {rate} trials of" in said and f"or {rate_power} diagnoses" in said
    assert f"would take {wall} and {wall_power}, {disk} of disk" in said
    assert f"{workers.removesuffix(' GB')} and {workers_power} of memory for the workers" in said
    free = named("study-shares")["shares"]["without_lock_share"]
    threads = [row(named("study-cost")["threads"], study=s, workers=4)["trials_per_s"] for s in ("spread", "power")]
    assert f"Four threads finish {threads[0]:.1f} and {threads[1]:.2f}, because only {100 * free:.0f} %" in said


def test_the_newest_dispatch_is_that_of_the_most_workers_and_trials() -> None:
    found = named("study-cost")
    rows = [
        {"engine": "threads", "workers": 4, "trials": 100_000, "trials_per_s": 9000.0},
        {"engine": "cluster", "workers": 1, "trials": 100_000, "trials_per_s": 900.0},
        {"engine": "cluster", "workers": 4, "trials": 1_000, "trials_per_s": 700.0},
        {"engine": "cluster", "workers": 4, "trials": 10_000, "trials_per_s": 400.0},
    ]
    cost = Cost.of({**found, "trials_that_do_nothing": rows}, "spread")
    assert cost.dispatch_per_s == 400.0 and cost.rate_per_s(64) == 400.0
    with pytest.raises(SystemExit, match="measure all parts"):
        Cost.of({**found, "book_keeping": []}, "spread")


def test_rates_and_memory_on_the_page_are_those_of_the_result() -> None:
    found = named("study-cost")
    for workers in (1, 2, 4):
        spread, power = (row(found["threads"], study=study, workers=workers) for study in ("spread", "power"))
        cells = [workers, f"{spread['trials_per_s']:.1f}", f"{spread['peak_mb']:.0f}"]
        cells += [f"{power['trials_per_s']:.2f}", f"{power['peak_mb']:.0f}"]
        assert f"| threads | {' | '.join(map(str, cells))} |" in PAGE
        apart = row(found["cluster"], study="spread", workers=workers)
        start = f"{workers} | {apart['trials_per_s']:.1f} | {apart['worker_peak_mb']:.0f} each |"
        assert f"| cluster, one thread each | {start}" in PAGE


def test_the_stages_on_the_page_are_those_of_the_result() -> None:
    found = named("study-shares")["shares"]
    stages = dict(re.findall(r"^\| (draw|model|plan|bench|play|record|measure): [^|]*\| (.*) \|$", PAGE, re.MULTILINE))
    assert stages == {
        name: f"{100 * one['share']:.0f} % | {100 * one['without_lock_ms'] / found['trial_ms']:.0f} %"
        for name, one in found["stages"].items()
    }
    free = found["without_lock_share"]
    assert f"So {100 * free:.0f} % of a settling trial" in PAGE
    assert f"1 / (1 − {free:.2f}) = {1 / (1 - free):.1f} times one" in PAGE
