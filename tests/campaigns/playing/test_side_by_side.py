"""Jobs side by side: all done once, at most so many at a time; errors, pauses and aborts end them in good order."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from campaigns.playing.interrupts import Interrupts
from campaigns.playing.side_by_side import MOST_WORKERS, free_cores, share

DEADLINE_S = 20.0  # far longer than any step here takes; reached only by a deadlock


def test_as_many_cores_as_there_are_but_not_more_than_help(monkeypatch):
    monkeypatch.setattr("os.sched_getaffinity", lambda _pid: set(range(64)), raising=False)
    assert free_cores() == MOST_WORKERS
    monkeypatch.setattr("os.sched_getaffinity", lambda _pid: {7}, raising=False)
    assert free_cores() == 1
    monkeypatch.delattr("os.sched_getaffinity")
    monkeypatch.setattr("os.cpu_count", lambda: None)
    assert free_cores() == 1


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_every_job_is_done_once(workers):
    done: list[int] = []
    share(range(50), done.append, workers, Interrupts())
    assert sorted(done) == list(range(50))


def test_one_worker_works_in_order_and_in_this_thread():
    seen = []
    share("abc", lambda job: seen.append((job, threading.get_ident())), 1, Interrupts())
    assert seen == [(job, threading.get_ident()) for job in "abc"]


def test_jobs_run_at_the_same_time_and_never_more_than_the_workers():
    both = threading.Barrier(2)  # passed only when two are inside at once
    running, most, lock = [], [], threading.Lock()

    def job(number):
        with lock:
            running.append(number)
            most.append(len(running))
        both.wait(DEADLINE_S)
        with lock:
            running.remove(number)

    share(range(8), job, 2, Interrupts())
    assert max(most) == 2


@pytest.mark.parametrize("by_helper", [True, False])
def test_an_error_lets_what_runs_end_begins_nothing_more_and_is_raised(by_helper):
    main, both, failed, ended = threading.get_ident(), threading.Barrier(2), threading.Event(), []

    def job(number):
        if number < 2:
            both.wait(DEADLINE_S)
        if number < 2 and (threading.get_ident() != main) == by_helper:
            failed.set()
            raise ValueError("it")
        failed.wait(DEADLINE_S)
        ended.append(number)

    with pytest.raises(ValueError, match="it"):
        share(range(1000), job, 2, Interrupts())
    # the other may begin jobs until the queue is emptied, which is the next thing that the failing one does
    assert 1 <= len(ended) < 998


def test_a_pause_lets_what_runs_end_and_begins_nothing_more():
    signals, both, ended = Interrupts(), threading.Barrier(2), []

    def job(number):
        both.wait(DEADLINE_S)
        signals.pausing = True
        ended.append(number)

    share(range(10), job, 2, signals)
    assert sorted(ended) == [0, 1]


def test_an_abort_reaches_a_helper_that_would_go_on_for_long():
    main = threading.get_ident()
    stopped: list[bool] = []

    def job(_number):
        if threading.get_ident() == main:
            started.wait(DEADLINE_S)
            return
        try:
            for _ in range(int(DEADLINE_S / 0.01)):
                with signals.abortable():
                    if not started.is_set():
                        started.set()
                        os.kill(os.getpid(), signal.SIGTERM)
                    threading.Event().wait(0.01)
        except KeyboardInterrupt:
            stopped.append(True)
            raise

    started = threading.Event()
    with pytest.raises(KeyboardInterrupt), Interrupts() as signals:
        share(range(2), job, 2, signals)
    assert stopped == [True]
