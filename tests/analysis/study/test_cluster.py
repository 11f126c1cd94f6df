"""Studies on a real cluster: the same bytes as in threads, whichever workers come, go or are killed."""

from __future__ import annotations

import signal
import sys
from contextlib import closing
from pathlib import Path

import pytest

from analysis.study import engines
from analysis.study.definition import parse_study
from analysis.study.kinds import KINDS
from analysis.study.run import run_study
from sim_backend.errors import ConfigError, HardwareError
from sim_backend.model import dump_model, load_model
from tests.analysis.study.conftest import MISSING, Cluster
from tests.analysis.study.studies import SPREAD, results, smallest, spread

TRIALS = 40


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What two threads give."""
    folder = tmp_path_factory.mktemp("threads")
    run_study(spread(TRIALS), folder, workers=2)
    return results(folder)


def test_a_killed_worker_loses_nothing_and_a_new_one_helps(
    cluster: Cluster, reference: dict[str, bytes], tmp_path: Path
) -> None:
    workers = [cluster.worker(), cluster.worker(threads=2)]
    kills = {10: 0, 30: 1}  # after so many trials, the worker of this number

    def report(done: float, _total: float, _what: str) -> None:
        for after in [n for n in kills if done >= n]:
            workers[kills.pop(after)].send_signal(signal.SIGKILL)
            cluster.worker()

    outcome = run_study(spread(TRIALS), tmp_path, address=cluster.address, report=report)
    assert not kills and [w.wait(timeout=10) for w in workers] == [-signal.SIGKILL] * 2
    # every trial is there once, and is what a thread gives, whoever did it
    assert (outcome.status, outcome.timing.trials) == ("complete", 2 * TRIALS)
    assert results(tmp_path) == reference


@pytest.mark.slow
def test_trials_of_every_kind_give_the_same_bytes_in_one_thread_in_four_and_on_a_cluster(
    cluster: Cluster, tmp_path: Path
) -> None:
    cluster.worker()
    for kind in KINDS:
        study = smallest(kind, 4)
        done = run_study(study, tmp_path / kind / "one", workers=1)
        assert (done.summary.points[0].done, done.summary.failed, done.summary.broken) == (4, 0, 0), kind
        run_study(study, tmp_path / kind / "four", workers=4)
        run_study(study, tmp_path / kind / "cluster", address=cluster.address)
        one = results(tmp_path / kind / "one")
        assert results(tmp_path / kind / "four") == one, kind
        assert results(tmp_path / kind / "cluster") == one, kind


def test_a_pause_leaves_the_cluster_at_once_and_the_study_goes_on(
    cluster: Cluster, reference: dict[str, bytes], tmp_path: Path
) -> None:
    cluster.worker()

    pauses = [10]

    def report(done: float, _total: float, _what: str) -> None:
        if pauses and done >= pauses[0]:
            pauses.clear()  # a second Ctrl-C would abort
            signal.raise_signal(signal.SIGINT)

    paused = run_study(spread(TRIALS), tmp_path, address=cluster.address, report=report)
    assert paused.status == "paused" and 10 <= paused.timing.trials < 20
    outcome = run_study(spread(TRIALS), tmp_path, address=cluster.address, resume=True)
    assert (outcome.status, outcome.timing.trials) == ("complete", 2 * TRIALS - paused.timing.trials)
    assert results(tmp_path) == reference


def test_a_trial_that_has_cost_too_many_workers_ends_the_study_and_nothing_is_lost(
    reference: dict[str, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason=MISSING)
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "0")  # the first lost worker is one too many
    with closing(Cluster(tmp_path)) as cluster:
        worker = cluster.worker()

        def report(done: float, _total: float, _what: str) -> None:
            if done >= 10 and worker.poll() is None:
                cluster.worker()
                worker.kill()

        with pytest.raises(HardwareError, match="too many workers .* --resume"):
            run_study(spread(TRIALS), tmp_path / "s", address=cluster.address, report=report)
    outcome = run_study(spread(TRIALS), tmp_path / "s", resume=True)
    assert 0 < outcome.timing.trials <= 2 * TRIALS - 10
    assert results(tmp_path / "s") == reference


@pytest.mark.slow
def test_a_killed_scheduler_is_told_and_threads_go_on(
    cluster: Cluster, reference: dict[str, bytes], tmp_path: Path
) -> None:
    cluster.worker()

    def report(done: float, _total: float, _what: str) -> None:
        if done >= 10:
            cluster.scheduler.kill()

    with pytest.raises(HardwareError, match="is gone .* --resume goes on"):
        run_study(spread(TRIALS), tmp_path, address=cluster.address, report=report)
    outcome = run_study(spread(TRIALS), tmp_path, resume=True)
    assert 0 < outcome.timing.trials <= 2 * TRIALS - 10
    assert results(tmp_path) == reference


def test_a_worker_that_would_compute_something_else_is_refused(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    for folder, model in ((tmp_path, "design-4th-order"), (elsewhere, "design")):
        (folder / "design.toml").write_text(dump_model(load_model(model)))
    monkeypatch.chdir(tmp_path)
    cluster.worker(cwd=elsewhere)
    text = SPREAD.format(trials=1).replace("cycles = 2", 'cycles = 2\nmodel = "design.toml"')
    with pytest.raises(ConfigError, match="a worker of the cluster: not the same study in its files that the settings"):
        run_study(parse_study(text, "study"), tmp_path / "s", address=cluster.address)
    (elsewhere / "design.toml").unlink()
    text = text.replace("seed = 3", "seed = 4")
    with pytest.raises(ConfigError, match="a worker of the cluster cannot do this study: .*no such file"):
        run_study(parse_study(text, "study"), tmp_path / "t", address=cluster.address)


def test_a_worker_with_other_threads_of_blas_is_refused_by_name(cluster: Cluster, tmp_path: Path) -> None:
    cluster.worker(blas_threads=2)
    words = r"a worker of the cluster: .* threads of BLAS \(OPENBLAS_NUM_THREADS\): 2 instead of 1; start the workers"
    with pytest.raises(ConfigError, match=words):
        run_study(spread(1), tmp_path, address=cluster.address)


def test_a_cluster_without_workers_is_given_up_after_a_while(
    cluster: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engines, "ALONE_S", 1.0)
    told: list[str] = []
    with pytest.raises(HardwareError, match="no worker for 1 s"):
        run_study(spread(1), tmp_path, address=cluster.address, report=lambda _done, _total, what: told.append(what))
    assert told[0] == "0 of 2 trials, no worker: waiting"


def test_no_scheduler_and_no_library_are_told_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason=MISSING)
    monkeypatch.setattr(engines, "CONNECT_S", 1.0)
    with pytest.raises(HardwareError, match="no scheduler answers at tcp://127.0.0.1:9 "):
        run_study(spread(1), tmp_path / "a", address="tcp://127.0.0.1:9")
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ConfigError, match="mccd\\[cluster\\]"):
        run_study(spread(1), tmp_path / "b", address="tcp://127.0.0.1:9")
