"""How trials are handed out: tasks that take a while each, fewer trials near the end, and every trial once."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future
from pathlib import Path

import numpy as np
import pytest

from analysis.study import engines
from analysis.study.engines import AHEAD, MOST, Engine, groups_of
from analysis.study.run import missing_trials, run_study
from analysis.study.trial import Job, Outcome, run_trials
from sim_backend.kernel import machine, side_by_side
from sim_backend.kernel.structure import LANES, Structure
from tests.analysis.study.studies import results, spread


def handed_out(total: int, trial_s: float, workers: int = 1, whole: int = 1) -> list[tuple[int, ...]]:
    """Return the tasks of a study whose trials take so long, of which each is done when it is begun."""
    tasks: list[tuple[int, ...]] = []

    def begin(trials: tuple[int, ...]) -> Future[list[Outcome]]:
        tasks.append(trials)
        future: Future[list[Outcome]] = Future()
        future.set_result([Outcome(trial, "done", "", (), (), trial_s) for trial in trials])
        return future

    engine = Engine(begin, lambda: workers, 1.0, whole)
    done = [o.trial for some in engine.outcomes(missing_trials(np.zeros(total, dtype=bool)), total) for o in some]
    assert sorted(done) == list(range(total))
    return tasks


def sizes(tasks: Sequence[Sequence[int]]) -> list[int]:
    return [len(task) for task in tasks]


def test_short_trials_go_out_by_the_hundred() -> None:
    found = sizes(handed_out(20_000, 0.005))
    # 200 of 5 ms take the second that a task should
    assert max(found) == 200 and np.mean(found) > 64
    assert max(sizes(handed_out(20_000, 1e-6))) == MOST
    # the first tasks say how long a trial takes
    assert found[:AHEAD] == [1] * AHEAD


def test_tasks_are_whole_groups_of_lanes_where_they_can_be() -> None:
    found = sizes(handed_out(5_000, 0.005, whole=24))
    assert max(found) == 192 and all(size % 24 == 0 for size in found if size > 24)


def test_groups_are_of_one_point_and_go_through_the_draws_once() -> None:
    groups = list(groups_of(range(5, 70), points=3))
    assert sorted(trial for group in groups for trial in group) == list(range(5, 70))
    assert all(len({trial % 3 for trial in group}) == 1 and len(group) <= LANES for group in groups)
    assert sum(len(group) < LANES for group in groups) <= 3
    # a drawn model is kept for the other points of its draw, which must not be far
    assert all(b[0] // 3 > a[-1] // 3 - 2 * LANES for a, b in zip(groups, groups[1:-3], strict=False))


def test_long_trials_go_out_one_by_one() -> None:
    assert set(sizes(handed_out(50, 3.4))) == {1}


def test_near_the_end_tasks_shrink_so_that_all_workers_end_together() -> None:
    found = sizes(handed_out(5_000, 0.005, workers=8))
    left = 5_000 - np.cumsum(found)
    # nobody takes more than his share of what is left
    assert all(size <= max((rest + size) // (AHEAD * 8), 1) for size, rest in zip(found, left, strict=True))
    assert set(found[-AHEAD * 8 :]) == {1}


@pytest.mark.parametrize("task_s", [0.0, 10.0])
def test_the_size_of_tasks_changes_no_byte(
    task_s: float, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders = [tmp_path_factory.mktemp("study") for _ in range(2)]
    run_study(spread(12), folders[0], workers=1)
    asked: list[int] = []

    def noted(job: Job, trials: Sequence[int]) -> list[Outcome]:
        asked.append(len(trials))
        return run_trials(job, trials)

    monkeypatch.setattr(engines, "THREAD_TASK_S", task_s)
    monkeypatch.setattr(engines, "run_trials", noted)
    run_study(spread(12), folders[1], workers=1)
    assert results(folders[1]) == results(folders[0])
    assert (max(asked) > 1) is (task_s > 0.0)


@pytest.mark.parametrize("workers", [1, 2])
def test_trials_side_by_side_change_no_byte(workers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    loop_of = machine.loop_of

    def noted(structure: Structure) -> machine.Play:
        asked.append(structure.lanes)
        return loop_of(structure)

    monkeypatch.setattr(machine, "loop_of", noted)
    monkeypatch.setattr(engines, "THREAD_TASK_S", 10.0)
    for lanes in (False, True):
        monkeypatch.setattr(side_by_side, "_is_there", lambda *_, lanes=lanes: lanes)
        asked.clear()
        run_study(spread(40), tmp_path / str(lanes), workers=workers)
        assert (LANES in asked) is lanes
    assert results(tmp_path / "True") == results(tmp_path / "False")
