"""Where trials are computed: threads of this process, or a cluster of `dask.distributed`. The same trials on either."""

from __future__ import annotations

import contextlib
import logging
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from typing import Any

from analysis.study.fingerprint import fingerprint, require_same
from analysis.study.trial import Job, Outcome, run_trial
from sim_backend.errors import ConfigError, HardwareError
from sim_backend.memory import keep_freed_memory

AHEAD = 3
"""Trials begun or waiting per worker: none idles while what is finished is being saved, and few are lost by a kill."""

ASKED_AGAIN_S = 2.0
ALONE_S = 60.0
"""How long a cluster may be without any worker before the study gives up; it can be resumed."""

CONNECT_S = 10.0


@dataclass(frozen=True)
class Engine:
    """An executor for trials: `begin` starts one, `workers` says how many can run at once now."""

    begin: Callable[[int], Future[Outcome]]
    workers: Callable[[], int]

    def outcomes(self, trials: Iterator[int], pausing: Callable[[], bool] = lambda: False) -> Iterator[list[Outcome]]:
        """Yield what has finished, some at a time, until `trials` ends and all that was begun is done.

        Once `pausing`, no trial is begun, and what can be is taken back: what waits for a thread, all that is on a
        cluster. Yields nothing (an empty list) now and then while there is no worker, and raises HardwareError when
        none comes.
        """
        running: set[Future[Outcome]] = set()
        alone_since: float | None = None
        while True:
            workers = self.workers()
            if pausing():
                running = {future for future in running if not future.cancel()}
                trials = iter(())
            for trial in islice(trials, max(AHEAD * max(workers, 1) - len(running), 0)):
                running.add(self.begin(trial))
            if not running:
                return
            done, running = wait(running, ASKED_AGAIN_S, FIRST_COMPLETED)
            lost = [future for future in done if future.cancelled() or future.exception() is not None]
            good = [future.result() for future in done if future not in lost]
            if good or not workers:
                yield good
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
    try:
        yield Engine(lambda trial: pool.submit(_tried, job, trial), lambda: workers)
    finally:
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
                yield Engine(lambda trial: executor.submit(_on_worker, held, trial), _Workers(client, address))
        finally:
            with contextlib.suppress(Exception):  # a scheduler that has gone away cannot be taken leave of
                client.close(timeout=CONNECT_S)


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Keep `distributed` from telling of a lost connection what the error then says in one line."""
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


def _on_worker(held: _Held, trial: int) -> Outcome:
    """Do a trial on a worker; raises ConfigError where it would not give what another gives."""
    if held.difference:
        raise ConfigError(held.difference)
    return _tried(held.job, trial)


def _tried(job: Job, trial: int) -> Outcome:
    keep_freed_memory()
    return run_trial(job, trial)
