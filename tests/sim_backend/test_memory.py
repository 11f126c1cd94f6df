"""Memory that trials free stays with the process: the system is not asked for it again."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import pytest

from analysis.study import engines
from analysis.study.run import run_study
from tests.analysis.study.studies import spread

ROOT = Path(__file__).parents[2]

FAULTS = """
import resource, sys
import numpy as np
from sim_backend.memory import keep_freed_memory

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(10):
        arrays = [np.ones(200_000) for _ in range(8)]
        del arrays
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

faults()
given_back = faults()
assert keep_freed_memory()
faults()
print(given_back, faults())
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="the C library is not glibc")
def test_freed_arrays_are_not_asked_of_the_system_again() -> None:
    done = subprocess.run([sys.executable, "-c", FAULTS], capture_output=True, text=True, check=True, cwd=ROOT)
    given_back, kept = map(int, done.stdout.split())
    # ten rounds of 8 × 1.6 MB are 31,000 pages of 4 KB; what is kept needs none of them again
    assert given_back > 1000 and kept < 100


SHARED = """
import resource, sys
from threading import Thread
import numpy as np
from sim_backend.memory import keep_long_arrays

if sys.argv[1] == "shared":
    assert keep_long_arrays()

def work():
    arrays = [np.ones(2_000_000) for _ in range(8)]
    del arrays

def faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(4):
        threads = [Thread(target=work) for _ in range(2)]
        for thread in threads:
            thread.start()
            thread.join()
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

faults()
print(faults())
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="the C library is not glibc")
def test_long_arrays_pass_from_thread_to_thread() -> None:
    def faults(how: str) -> int:
        command = [sys.executable, "-c", SHARED, how]
        # where the system has huge pages free, numpy asks for them, and how many pages it takes hangs on luck
        small_pages = os.environ | {"NUMPY_MADVISE_HUGEPAGE": "0"}
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT, env=small_pages)
        return int(done.stdout)

    alone, shared = faults("alone"), faults("shared")
    # eight rounds of 8 x 16 MB are 250,000 pages of 4 KB; of these a thread's own heap keeps what it has room for
    assert alone > 10_000 and shared < 1000


def test_threads_keep_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[bool] = []
    monkeypatch.setattr(engines, "keep_freed_memory", lambda: told.append(True))
    run_study(spread(1), tmp_path, workers=1)
    assert told == [True, True]
