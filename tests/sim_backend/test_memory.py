"""Memory that trials free stays with the process: the system is not asked for it again."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from pathlib import Path

import pytest

from analysis.study import engines
from analysis.study.run import run_study
from tests.analysis.study.studies import spread

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
    done = subprocess.run(
        [sys.executable, "-c", FAULTS], capture_output=True, text=True, check=True, cwd=Path(__file__).parents[2]
    )
    given_back, kept = map(int, done.stdout.split())
    # ten rounds of 8 × 1.6 MB are 31,000 pages of 4 KB; what is kept needs none of them again
    assert given_back > 1000 and kept < 100


def test_threads_keep_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[bool] = []
    monkeypatch.setattr(engines, "keep_freed_memory", lambda: told.append(True))
    run_study(spread(1), tmp_path, workers=1)
    assert told == [True, True]
