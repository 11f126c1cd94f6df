"""A real cluster on this machine: a scheduler and workers, each a process of its own that can be killed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PATIENCE_S = 60.0
MISSING = "dask.distributed is not installed: pip install 'mccd[cluster]'"


class Cluster:
    """A scheduler at a free port of the loopback and the workers that a test starts."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._file = folder / "scheduler.json"
        self._started: list[subprocess.Popen[bytes]] = []
        options = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--no-show"]
        self.scheduler = self._start("scheduler", [*options, "--scheduler-file", str(self._file)], ROOT)
        self.address = self._address()

    def _start(self, what: str, options: list[str], cwd: Path, blas_threads: int = 1) -> subprocess.Popen[bytes]:
        number = len(self._started)
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *options]
        environment = os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": str(blas_threads)}
        with (self._folder / f"{what}-{number}.log").open("wb") as words:
            process = subprocess.Popen(command, cwd=cwd, stdout=words, stderr=words, env=environment)
        self._started.append(process)
        return process

    def _address(self) -> str:
        for _ in range(int(PATIENCE_S / 0.05)):
            try:
                address: str = json.loads(self._file.read_text())["address"]
                return address
            except (OSError, ValueError):
                time.sleep(0.05)
        raise TimeoutError("the scheduler did not start")

    def worker(self, threads: int = 1, cwd: Path = ROOT, blas_threads: int = 1) -> subprocess.Popen[bytes]:
        """Start a worker; it comes when it has started."""
        folder = self._folder / f"worker-{len(self._started)}"
        options = [self.address, "--nthreads", str(threads), "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]
        return self._start("worker", [*options, "--local-directory", str(folder)], cwd, blas_threads)

    def close(self) -> None:
        for process in self._started:
            process.kill()
        for process in self._started:
            process.wait(timeout=PATIENCE_S)


@pytest.fixture
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler without workers."""
    pytest.importorskip("distributed", reason=MISSING)
    started = Cluster(tmp_path_factory.mktemp("cluster"))
    yield started
    started.close()
