"""The measurement of studies measures what ran, and notices when two engines disagree."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from analysis.study.definition import load_study
from analysis.study.kinds import KINDS
from analysis.study.trial import Job, run_trial
from benchmarks import study_cost
from benchmarks.study_cost import Sizes, book_keeping, main, measure, nothing_on_cluster, same, studied
from benchmarks.study_trials import SPREAD, STAGES, Clock, clocked, shares


def test_one_small_study_and_its_book_keeping_are_measured(tmp_path: Path) -> None:
    rows = [studied("spread", 1, tmp_path, "--workers", str(n)) for n in (1, 2)]
    for row in rows:
        assert row["trials"] == 2  # one draw at two points
        assert 0.0 < row["mean_trial_s"] < row["wall_s"] and row["peak_mb"] > 50.0
        assert len(row["load_1min"]) == 2
    assert same(rows)
    assert not same([rows[0], {**rows[1], "sha256": "other"}])
    kept = book_keeping(200, 100, tmp_path)
    size = kept["bytes_per_trial"]
    assert size["trials.sqlite"] > 100.0  # ten numbers of 8 bytes, and what SQLite needs around them
    assert size["trials.csv"] > 100.0


def test_trials_that_do_nothing_go_through_a_study(tmp_path: Path) -> None:
    found = measure(["nothing"], Sizes(workers=(2,), nothing=()), tmp_path)
    assert found == {"trials_that_do_nothing": []}
    row = study_cost.nothing_in_threads(30, 2, tmp_path)
    assert (row["engine"], row["workers"], row["trials"]) == ("threads", 2, 30)
    # three tasks for each of two threads are under way at most. The first are of one trial each, and a task is at most
    # twice as large as what has finished: six trials, then twelve, so that thirty take three transactions or more
    assert 3 <= row["transactions"] <= 30
    assert 0.0 < row["store_s"] < row["trials_wall_s"] < row["wall_s"] and row["bytes_per_trial"]["trials.csv"] > 10.0
    assert "nothing" not in KINDS  # only in processes that are measured


@pytest.mark.slow
def test_trials_that_do_nothing_go_through_a_cluster(tmp_path: Path) -> None:
    pytest.importorskip("distributed", reason="dask.distributed is not installed: pip install 'mccd[cluster]'")
    (row,) = nothing_on_cluster([20], 1, tmp_path)
    assert (row["engine"], row["trials"]) == ("cluster", 20)
    assert row["scheduler_peak_mb"] > 50.0 and row["worker_peak_mb"] > 50.0


def test_a_stage_is_timed_without_the_stages_that_it_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr(time, "thread_time", lambda: now[0])
    clock = Clock()

    def passing(seconds: float) -> float:
        now[0] += seconds
        return now[0]

    compiled = clock.free(passing)
    inner = clock.stage("inner", lambda: (passing(1.0), compiled(2.0)))
    outer = clock.stage("outer", lambda: (inner(), passing(4.0), inner()))
    outer()
    assert clock.take() == ({"inner": 6.0, "outer": 4.0}, {"inner": 4.0})
    assert clock.take() == ({}, {})


def test_the_shares_add_up_to_the_trial_and_change_no_result() -> None:
    job = Job.of(load_study(SPREAD))
    plain = run_trial(job, 1)
    with clocked():
        timed = run_trial(job, 1)
    assert (timed.status, timed.varied, timed.results) == (plain.status, plain.varied, plain.results)
    found = shares(9, warm=2, give_back=True)  # this process is that of all tests
    assert found["keeps_freed_memory"] is False and found["page_faults_per_trial"] >= 0.0
    stages = found["stages"]
    assert set(stages) == {stage for _, _, stage in STAGES}
    # means add up; a tenth for what stands between the stages, and half a unit of the last of three digits for each
    assert 0.9 < sum(one["share"] for one in stages.values()) < 1.0 + 0.0005 * len(stages)
    # only playing is compiled, and all of that stands inside it
    assert 0.0 < stages["play"]["without_lock_ms"] < stages["play"]["ms"]
    assert all(one["without_lock_ms"] == 0.0 for name, one in stages.items() if name != "play")
    assert 0.0 < found["without_lock_share"] < 1.0


def test_a_result_that_names_no_commit_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--commit", "unknown", "--out", str(tmp_path / "r.json")])
    assert "name their --commit" in capsys.readouterr().err
    assert not (tmp_path / "r.json").exists()
