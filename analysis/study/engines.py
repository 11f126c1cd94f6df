"""Where trials are computed: threads of this process, or a cluster of `dask.distributed`. The same trials on either."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from threading import Event
from typing import Any

from analysis.study.fingerprint import fingerprint, require_same
from analysis.study.trial import Job, Outcome, run_trials
from sim_backend.errors import ConfigError, HardwareError
from sim_backend.kernel.structure import LANES
from sim_backend.memory import keep_freed_memory

AHEAD = 3
"""Tasks begun or waiting per worker: none idles while what is finished is being saved, and few are lost by a kill."""

MOST = 256
"""Trials in a task at most."""

THREAD_TASK_S, CLUSTER_TASK_S = 0.1, 1.0
"""How long a task should take. A task costs a cluster 3 to 6 ms beside its trials, a thread a tenth of one."""

ASKED_AGAIN_S = 2.0
ALONE_S = 60.0
"""How long a cluster may be without any worker before the study gives up; it can be resumed."""

CONNECT_S = 10.0


class _Sizes:
    """How many trials a task gets: so many as take `task_s` by what has finished, and fewer near the end of a study.

    What is more than `whole` is a multiple of it.
    """

    def __init__(self, task_s: float, missing: int, whole: int) -> None:
        self._task_s, self._left, self._whole = task_s, missing, whole
        self._trials, self._seconds, self._largest = 0, 0.0, 1

    def done(self, outcomes: Sequence[Outcome]) -> None:
        """Count what has finished; tasks at most double with each, for the first trials may not be like the others."""
        self._trials, self._seconds = self._trials + len(outcomes), self._seconds + sum(o.wall_s for o in outcomes)
        if 2 * len(outcomes) > self._largest:
            self._largest = min(2 * self._largest, MOST)

    def take(self, trials: Iterator[int], workers: int) -> tuple[int, ...]:
        """Return the trials of the next task, none when there are no more."""
        fitting = self._trials * self._task_s / self._seconds if self._seconds else 1.0
        fair = max(self._left // (AHEAD * max(workers, 1)), self._whole)
        size = max(int(min(self._largest, fitting, fair)), 1)
        size -= size % self._whole if size > self._whole else 0
        taken = tuple(islice(trials, size))
        self._left -= len(taken)
        return taken


@dataclass(frozen=True)
class Engine:
    """An executor for trials: `begin` starts a task of some, `workers` says how many can run at once now.

    A task gives what came of its trials; fewer than it was given once `stop` was called, if it can stop. Tasks are
    made to take `task_s` and, where they can be, of `whole` groups of trials.
    """

    begin: Callable[[tuple[int, ...]], Future[list[Outcome]]]
    workers: Callable[[], int]
    task_s: float
    whole: int = 1
    stop: Callable[[], None] = lambda: None

    def outcomes(
        self, trials: Iterator[int], missing: int, pausing: Callable[[], bool] = lambda: False
    ) -> Iterator[list[Outcome]]:
        """Yield what has finished, some at a time, until the `missing` `trials` end and all that was begun is done.

        Once `pausing`, no trial is begun, and what can be is taken back: what waits for a thread, all that is on a
        cluster. Yields nothing (an empty list) now and then while there is no worker, and raises HardwareError when
        none comes.
        """
        running: set[Future[list[Outcome]]] = set()
        sizes = _Sizes(self.task_s, missing, self.whole)
        alone_since: float | None = None
        while True:
            workers = self.workers()
            if pausing():
                self.stop()
                running = {future for future in running if not future.cancel()}
                trials = iter(())
            while len(running) < AHEAD * max(workers, 1) and (task := sizes.take(trials, workers)):
                running.add(self.begin(task))
            if not running:
                return
            done, running = wait(running, ASKED_AGAIN_S, FIRST_COMPLETED)
            lost = [future for future in done if future.cancelled() or future.exception() is not None]
            good = [future.result() for future in done if future not in lost]
            for outcomes in good:
                sizes.done(outcomes)
            if good or not workers:
                yield [outcome for outcomes in good for outcome in outcomes]
            for future in lost:
                future.result()  # raises
            now = time.monotonic()
            alone_since = None if workers or done else alone_since or now
            if alone_since is not None and now - alone_since > ALONE_S:
                raise HardwareError(
                    f"the cluster has had no worker for {ALONE_S:g} s; what finished is saved: start workers, then "
                    "--resume"
                )


@contextlib.contextmanager
def threads(job: Job, workers: int) -> Iterator[Engine]:
    """Give an engine of `workers` threads: the compiled part of a trial leaves Python to the others."""
    pool = ThreadPoolExecutor(workers, thread_name_prefix="trial")
    stopped = Event()
    try:
        yield Engine(
            lambda trials: pool.submit(_tried, job, trials, stopped.is_set),
            lambda: workers,
            THREAD_TASK_S,
            LANES * len(job.study.points),
            stopped.set,
        )
    finally:
        stopped.set()
        pool.shutdown(wait=True, cancel_futures=True)


@contextlib.contextmanager
def cluster(job: Job, parts: dict[str, str], address: str) -> Iterator[Engine]:
    """Give an engine on the scheduler at `address`; workers may come and go.

    A trial whose worker is lost is done again by another. Raises ConfigError when `distributed` is not installed or a
    worker is not the same mccd, HardwareError when there is no scheduler or it goes away.
    """
    with _quiet():
        client = _client(address)
        try:
            executor: Executor = client.get_executor(pure=False)
            # a task of its own, so that the scheduler can make it again wherever it is lost
            held = client.submit(_Held, job, parts, pure=False)
            with _clear_errors(address):
                yield Engine(
                    lambda trials: executor.submit(_on_worker, held, trials),
                    _Workers(client, address),
                    CLUSTER_TASK_S,
                    LANES * len(job.study.points),
                )
        finally:
            with contextlib.suppress(Exception):  # a scheduler that has gone away cannot be taken leave of
                client.close(timeout=CONNECT_S)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence the messages of `distributed` about a lost connection, which the error states in one line."""
    talk = logging.getLogger("distributed")
    level = talk.level
    talk.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        talk.setLevel(level)


@dataclass(frozen=True)
class _Held:
    """A study as a worker holds it, and what this worker would compute differently, found once per worker."""

    job: Job
    parts: dict[str, str]

    @cached_property
    def difference(self) -> str:
        """What is not the same here, empty where all is."""
        fix = "start the workers in the folder of the study, with the same installation on the same kind of machine"
        try:
            found = fingerprint(self.job)
        except ConfigError as error:
            return f"a worker of the cluster cannot do this study: {error}; {fix}"
        try:
            require_same(self.parts, found, "a worker of the cluster", fix)
        except ConfigError as error:
            return str(error)
        return ""

    def __reduce__(self) -> tuple[type[_Held], tuple[Job, dict[str, str]]]:
        return _Held, (self.job, self.parts)  # another worker finds its own difference


class _Workers:
    """Counts the threads of all workers, asking the scheduler now and then."""

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        self._asked, self._count = float("-inf"), 0

    def __call__(self) -> int:
        now = time.monotonic()
        if now - self._asked > ASKED_AGAIN_S:
            try:
                self._asked, self._count = now, sum(self._client.nthreads().values())
            except (OSError, TimeoutError) as error:
                raise _gone(self._address, error) from None
        return self._count


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise ConfigError(
            "a cluster needs dask.distributed, which is not installed: pip install 'mccd[cluster]'"
        ) from None
    try:
        connect: Any = Client
        return connect(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise HardwareError(
            f"no scheduler answers at {address} ({type(error).__name__}); start one with 'dask scheduler' and give its "
            "address"
        ) from None


@contextlib.contextmanager
def _clear_errors(address: str) -> Iterator[None]:
    from distributed import KilledWorker
    from distributed.comm.core import CommClosedError

    try:
        yield
    except KilledWorker as error:
        raise HardwareError(
            f"a trial has cost the cluster at {address} too many workers ({' '.join(str(error).split())[:200]}); what "
            "finished is saved: give the workers more memory, then --resume"
        ) from None
    except (CommClosedError, CancelledError) as error:
        raise _gone(address, error) from None


def _gone(address: str, error: BaseException) -> HardwareError:
    return HardwareError(
        f"the cluster at {address} is gone ({type(error).__name__}); what finished is saved: --resume goes on"
    )


def _on_worker(held: _Held, trials: tuple[int, ...]) -> list[Outcome]:
    """Do trials on a worker; raises ConfigError where it would not give what another gives."""
    if held.difference:
        raise ConfigError(held.difference)
    return _tried(held.job, trials)


def _tried(job: Job, trials: tuple[int, ...], stopped: Callable[[], bool] = lambda: False) -> list[Outcome]:
    """Do trials, those of one point of the grid side by side, until all are done or `stopped`."""
    keep_freed_memory()
    done: list[Outcome] = []
    for group in groups_of(trials, len(job.study.points)):
        if stopped():
            break
        done += run_trials(job, group)
    return done


def groups_of(trials: Sequence[int], points: int) -> Iterator[tuple[int, ...]]:
    """Yield the trials in groups of at most LANES, all of a group at one point, those of a draw near each other."""
    waiting: dict[int, list[int]] = {}
    for trial in trials:
        own = waiting.setdefault(trial % points, [])
        own.append(trial)
        if len(own) == LANES:
            yield tuple(own)
            own.clear()
    yield from (tuple(own) for own in waiting.values() if own)
