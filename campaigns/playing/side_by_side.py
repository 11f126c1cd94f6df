"""Do several jobs at once: this thread and its helpers take them from one queue until it is empty or one fails."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

from campaigns.playing.interrupts import Interrupts

T = TypeVar("T")

MOST_WORKERS = 4
"""More threads than this wait for each other's Python: about a third of a simulated run is not compiled."""


def free_cores() -> int:
    """Return how many cores this process may use, at most `MOST_WORKERS`."""
    try:
        cores = len(os.sched_getaffinity(0))
    except AttributeError:  # a system that cannot tell
        cores = os.cpu_count() or 1
    return min(cores, MOST_WORKERS)


def share(jobs: Iterable[T], do: Callable[[T], None], workers: int, signals: Interrupts) -> None:
    """Do every job once, in order of their start; with one worker, one after the other in this thread.

    A pause lets what has begun end and begins nothing else, and so does an error, which is raised when all have ended:
    this thread's own first. An abort stops the helpers as soon as they wait for their bench.
    """
    waiting = deque(jobs)

    def work() -> None:
        while not signals.pausing:
            try:
                job = waiting.popleft()
            except IndexError:
                return
            try:
                do(job)
            except BaseException:
                waiting.clear()
                raise

    helpers = min(workers, len(waiting)) - 1
    if helpers < 1:
        work()
        return
    with ThreadPoolExecutor(helpers, thread_name_prefix="run") as pool:
        helping = [pool.submit(work) for _ in range(helpers)]
        work()
        with signals.abortable():
            wait(helping)
    for helper in helping:
        helper.result()
