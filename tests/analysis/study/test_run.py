"""Whole studies: the same bytes for any number of threads and after any end, and a resumed one repeats nothing."""

from __future__ import annotations

import contextlib
import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from analysis.study import engines
from analysis.study.definition import parse_study
from analysis.study.run import missing_trials, run_study
from analysis.study.store import FILE
from analysis.study.trial import Job, run_trial, run_trials
from campaigns.plans.chop import ChopPlan
from sim_backend.bench import Bench, Segment
from sim_backend.errors import ConfigError, DataError
from tests.analysis.study.studies import SPREAD, results, spread
from tests.running import MCCD, REAL

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of 10 trials, done by one thread without a break."""
    folder = tmp_path_factory.mktemp("study") / "one"
    outcome = run_study(spread(), folder, workers=1)
    assert (outcome.status, outcome.timing.trials) == ("complete", 10)
    return folder


@pytest.mark.parametrize("workers", [2, 5])
def test_the_number_of_threads_changes_no_byte(workers: int, reference: Path, tmp_path: Path) -> None:
    run_study(spread(), tmp_path, workers=workers)
    assert results(tmp_path) == results(reference)


def test_a_study_is_its_trials_done_one_by_one(reference: Path) -> None:
    job = Job.of(spread())
    lines = (reference / "trials.csv").read_text().splitlines()
    assert len(lines) == 11
    for trial in (3, 0):  # in another order
        outcome = run_trial(job, trial)
        assert lines[trial + 1].split(",") == [str(trial), "done", "", *map(str, (*outcome.varied, *outcome.results))]


def test_more_draws_go_on_where_fewer_ended_and_limits_may_change(reference: Path, tmp_path: Path) -> None:
    run_study(spread(2), tmp_path, workers=1)
    again = run_study(spread(), tmp_path, workers=1, resume=True)
    assert again.timing.trials == 6
    assert results(tmp_path) == results(reference)
    looser = run_study(spread(more="[limits]\nsettling_s = 10.0\n"), tmp_path, resume=True)
    assert looser.timing.trials == 0
    shares = [p.numbers["settling_s"].within for p in looser.summary.points]
    assert [share and share.hits for share in shares] == [5, 5]


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("seed = 3", "seed = 4", "seed: 4 instead of 3"),
        ("cycles = 2", "cycles = 3", "settings"),
        ("std = 0.01", "std = 0.02", "what varies"),
        ("trials = 5", 'trials = 5\nmodel = "printed"', "models"),
    ],
)
def test_a_changed_study_is_refused(old: str, new: str, part: str, reference: Path) -> None:
    text = SPREAD.format(trials=5).replace(old, new)
    with pytest.raises(ConfigError, match=f"not the same study in its {part}"):
        run_study(parse_study(text, "study"), reference, resume=True)


def test_other_threads_of_blas_are_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    run_study(spread(1), tmp_path, workers=1)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    with pytest.raises(ConfigError, match=r"in its threads of BLAS \(OPENBLAS_NUM_THREADS\): 3 instead of 1"):
        run_study(spread(1), tmp_path, resume=True)
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(ConfigError, match="one for each of .* cores instead of 1"):
        run_study(spread(1), tmp_path, resume=True)


def test_a_file_that_the_settings_name_is_part_of_the_study(tmp_path: Path) -> None:
    from sim_backend.model import dump_model, load_model

    model = tmp_path / "design.toml"
    model.write_text(dump_model(load_model("design-4th-order")))
    text = SPREAD.format(trials=1).replace("cycles = 2", f'cycles = 2\nmodel = "{model}"')
    run_study(parse_study(text, "study"), tmp_path / "s", workers=1)
    model.write_text(dump_model(load_model("design")))
    with pytest.raises(ConfigError, match="files that the settings name"):
        run_study(parse_study(text, "study"), tmp_path / "s", resume=True)


def test_a_setting_that_cannot_be_is_refused_before_the_first_trial(tmp_path: Path) -> None:
    text = SPREAD.format(trials=1).replace('"mbff"]', '"mbff", "mbf"]')
    with pytest.raises(ConfigError, match="mbf"):
        run_study(parse_study(text, "study"), tmp_path / "s")
    assert not (tmp_path / "s").exists()


def test_progress_counts_what_is_left_of_this_run_alone(reference: Path, tmp_path: Path) -> None:
    run_study(spread(3), tmp_path, workers=1)
    told: list[tuple[float, float, str]] = []
    run_study(spread(), tmp_path, workers=1, resume=True, report=lambda *one: told.append(one))
    assert told[-1] == (4, 4, "10 of 10 trials")
    assert all(total == 4 for _, total, _ in told) and [d for d, _, _ in told] == sorted(d for d, _, _ in told)


def test_no_trial_is_reported_before_it_is_in_the_file(tmp_path: Path) -> None:
    told: list[tuple[float, int]] = []

    def report(done: float, _total: float, _what: str) -> None:
        # the study holds its file for itself: read what a power cut at this moment would leave
        left = tmp_path / f"left-{len(told)}"
        left.mkdir()
        for name in (FILE, f"{FILE}-wal"):
            shutil.copy(tmp_path / "s" / name, left / name)
        with contextlib.closing(sqlite3.connect(left / FILE)) as file:
            told.append((done, file.execute("SELECT COUNT(*) FROM trials").fetchone()[0]))

    run_study(spread(), tmp_path / "s", workers=2, report=report)
    assert told[-1] == (10, 10) and all(kept >= done for done, kept in told)


def test_the_missing_trials_of_a_huge_study_take_no_memory() -> None:
    there = np.ones(20_000_000, dtype=bool)
    gaps = [0, 3, 65_535, 65_536, 12_345_678, 19_999_999]
    there[gaps] = False
    assert list(missing_trials(there)) == gaps
    tracemalloc.start()
    try:
        first = [trial for trial, _ in zip(missing_trials(np.zeros_like(there)), range(10), strict=False)]
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert first == list(range(10))
    # the array itself, one byte each, and a block of whole numbers; all numbers at once would be 8 bytes each
    assert peak < 1.5 * there.size


def test_failed_trials_are_counted_and_the_rest_goes_on(tmp_path: Path) -> None:
    text = SPREAD.format(trials=3) + (
        '[[vary]]\nplace = "model.modes[theta_y suspension].input.torque_y"\nsweep = [3091.7, -3091.7]\n'
    )
    told: list[str] = []
    outcome = run_study(parse_study(text, "study"), tmp_path, report=lambda _done, _total, what: told.append(what))
    right, wrong = outcome.summary.points[::2], outcome.summary.points[1::2]
    assert all((p.done, p.failed) == (3, 0) for p in right) and all((p.done, p.failed) == (0, 3) for p in wrong)
    assert outcome.summary.failed == sum(r.trials for r in outcome.summary.reasons) == 6
    assert told[-1] == "12 of 12 trials, 6 came to nothing"
    assert (tmp_path / "trials.csv").read_text().count(",failed,") == 6


def test_what_fails_around_a_trial_stops_the_study_and_keeps_what_is_done(
    reference: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(job: Job, trials: tuple[int, ...]) -> object:
        if 4 in trials:
            raise OSError(28, "No space left on device")
        return run_trials(job, trials)

    with monkeypatch.context() as patched, pytest.raises(OSError, match="No space"):
        patched.setattr(engines, "run_trials", full)
        run_study(spread(), tmp_path, workers=1)
    outcome = run_study(spread(), tmp_path, workers=1, resume=True)
    assert 0 < outcome.timing.trials < 10
    assert results(tmp_path) == results(reference)


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises((DataError, OSError)):
        run_study(spread(), tmp_path / "file" / "s")


def running(folder: Path, study: Path, *more: str, most_bytes: int = 0) -> subprocess.Popen[bytes]:
    # a limit is that of the process itself
    command = [*(REAL if most_bytes else MCCD), "study", str(study), "-o", str(folder), "--workers", "2", *more]

    def limit() -> None:
        if most_bytes:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, most_bytes))

    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=ROOT, stdout=pipe, stderr=pipe, preexec_fn=limit)


def grown(folder: Path, size: int, process: subprocess.Popen[bytes]) -> bool:
    """Wait until the write-ahead log has grown beyond `size`; False when the program ended before."""
    log = folder / "trials.sqlite-wal"
    while process.poll() is None:
        if log.exists() and log.stat().st_size > size:
            return True
        time.sleep(0.002)
    return False


@pytest.mark.slow
def test_a_study_that_is_killed_again_and_again_ends_as_if_nothing_had_happened(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(SPREAD.format(trials=60))
    rng = np.random.default_rng(1)
    kills = 0
    for attempt in range(3):
        process = running(tmp_path / "killed", file, *(["--resume"] if attempt else []))
        if grown(tmp_path / "killed", int(rng.integers(20_000, 120_000)), process):
            process.send_signal(signal.SIGKILL)
            kills += 1
        process.communicate(timeout=120)
    assert kills >= 2
    last = running(tmp_path / "killed", file, "--resume")
    _, words = last.communicate(timeout=120)
    assert last.returncode == 0, words
    run_study(spread(60), tmp_path / "whole")
    assert results(tmp_path / "killed") == results(tmp_path / "whole")


def test_after_a_pause_no_trial_is_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[int] = []
    paused_at: list[int] = []

    def watched(job: Job, trials: tuple[int, ...]) -> object:
        begun.extend(trials)
        return run_trials(job, trials)

    def report(_done: float, _total: float, _what: str) -> None:
        if not paused_at:
            paused_at.append(len(begun))
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(engines, "run_trials", watched)
    outcome = run_study(spread(20), tmp_path, workers=1, report=report)
    assert outcome.status == "paused"
    # the thread may have taken one more between the count and the signal
    assert outcome.timing.trials == len(begun) <= paused_at[0] + 1


@pytest.mark.slow
def test_ctrl_c_saves_and_says_how_to_go_on(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(SPREAD.format(trials=3000))
    process = running(tmp_path / "s", file, "--json")
    assert grown(tmp_path / "s", 30_000, process)
    os.kill(process.pid, signal.SIGINT)
    out, words = process.communicate(timeout=120)
    assert process.returncode == 130
    assert b"--resume goes on" in words and b"Traceback" not in words
    assert b'"status": "paused"' in out
    done = run_study(parse_study(SPREAD.format(trials=2), "study"), tmp_path / "s", resume=True)
    assert done.timing.trials == 0  # the first trials are there


@pytest.mark.slow
def test_a_file_that_may_not_grow_ends_the_study_in_one_line_and_it_goes_on(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(SPREAD.format(trials=100))
    # room for some transactions; two hundred trials, at most six of them in each, need many times that
    process = running(tmp_path / "s", file, most_bytes=100_000)
    _, words = process.communicate(timeout=120)
    lines = [line for line in words.decode().splitlines() if "left" not in line]
    assert process.returncode == 4 and len(lines) == 1 and "trials.sqlite" in lines[0], words
    done = run_study(spread(100), tmp_path / "s", resume=True)
    assert 0 < done.timing.trials < 200
    run_study(spread(100), tmp_path / "whole")
    assert results(tmp_path / "s") == results(tmp_path / "whole")


@pytest.mark.slow
def test_told_to_end_it_ends_at_once_and_says_how_to_go_on(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(SPREAD.format(trials=3000))
    process = running(tmp_path / "s", file)
    assert grown(tmp_path / "s", 30_000, process)
    process.send_signal(signal.SIGTERM)
    out, words = process.communicate(timeout=120)
    assert process.returncode == 130
    assert b"what finished is saved" in words and b"--resume goes on" in words and b"Traceback" not in words
    assert out == b"" and not (tmp_path / "s" / "study.json").exists()
    # trials end in any order, and those that run at the signal are lost: what had ended is what is not done again
    with contextlib.closing(sqlite3.connect(tmp_path / "s" / FILE)) as file_of_trials:
        kept = sorted(trial for (trial,) in file_of_trials.execute("SELECT trial FROM trials"))
    assert len(kept) > 0
    draws = kept[-1] // 2 + 1  # two points a draw
    done = run_study(parse_study(SPREAD.format(trials=draws), "study"), tmp_path / "s", resume=True)
    assert done.timing.trials == 2 * draws - len(kept)


def test_a_plan_of_many_points_is_made_once_per_point(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[str] = []
    segments = ChopPlan.segments

    def counted(self: ChopPlan, bench: Bench) -> Iterator[Segment]:
        made.append(self.strategy)
        return segments(self, bench)

    monkeypatch.setattr(ChopPlan, "segments", counted)
    # settings of no other test, for what was planned before is kept
    text = SPREAD.format(trials=4).replace("cycles = 2", "cycles = 2\nto_rad = 7.1e-3")
    run_study(parse_study(text, "study"), tmp_path, workers=1)
    # once to check each point, once to play its four trials
    assert sorted(made) == ["hybrid", "hybrid", "mbff", "mbff"]
