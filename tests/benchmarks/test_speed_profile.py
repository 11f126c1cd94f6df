"""What is told of where time and memory go: by work whose place is known."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from benchmarks.speed.commands import Commands, Sampled
from benchmarks.speed.profile import profile
from benchmarks.speed.sampled import COMPILED, group_of, shares


@njit()
def compiled_sum(n: int) -> float:
    total = 0.0
    for k in range(n):
        total += np.sqrt(k)
    return total


def interpreted_sum(n: int) -> int:
    return sum(k & 3 for k in range(n))


def test_a_profile_tells_compiled_from_interpreted() -> None:
    compiled_sum(1)
    slow = profile(lambda: compiled_sum(30_000_000))
    assert "compiled_sum (" in slow[1] and slow[1].endswith("compiled by numba")
    by_hand = profile(lambda: interpreted_sum(100_000))
    assert not any("compiled_sum" in line for line in by_hand)
    assert any("interpreted_sum" in line or "genexpr" in line for line in by_hand[1:3])


def test_what_takes_no_time_is_not_in_a_profile() -> None:
    def work() -> None:
        abs(-1)
        time.sleep(0.2)

    lines = profile(work)
    assert "sleep" in lines[1] and len(lines) == 2


MAPS = """\
00001000-00002000 r-xp 00000000 00:00 0 /usr/bin/python3.11
00002000-00003000 r-xp 00000000 00:00 0
00003000-00004000 r-xp 00000000 00:00 0 /x/site-packages/numpy/_core/_multiarray_umath.cpython-311.so
00005000-00006000 r-xp 00000000 00:00 0 /lib/libc.so.6
"""


def test_an_instruction_belongs_to_the_code_around_it() -> None:
    found = shares([0x1000, 0x1FFF, 0x2800, 0x3000, 0x4800, 0x5000, 0x6000, 0x10], MAPS)
    eighth = 1.0 / 8.0
    assert found == {
        "Python": 2 * eighth,
        "compiled by numba and llvmlite": eighth,
        "compiled libraries": eighth,
        "C library": eighth,
        "elsewhere": 3 * eighth,
    }


@pytest.mark.parametrize(
    ("mapped", "group"),
    [
        ("/usr/lib/libpython3.11.so.1.0", "Python"),
        ("/usr/lib/python3.11/lib-dynload/_json.so", "Python"),
        ("/lib/x86_64-linux-gnu/libm.so.6", "C mathematics"),
        ("/x/numpy.libs/libscipy_openblas64.so", "compiled libraries"),
        ("/x/llvmlite/binding/libllvmlite.so", "compiling"),
        ("[vdso]", "C library"),
    ],
)
def test_files_are_known_by_their_names(mapped: str, group: str) -> None:
    assert group_of(mapped) == group


def test_python_and_the_c_library_do_not_count_as_compiled() -> None:
    seen = {"shares": dict.fromkeys((*COMPILED, "Python", "C library"), 0.2)}
    assert Sampled(0, "", None, seen).compiled() == pytest.approx(60.0)
    assert np.isnan(Sampled(0, "", None, {"shares": None}).compiled())


def test_stacks_name_who_runs_and_who_takes_memory() -> None:
    """In a process of its own: pytest may have threads that wait in ways of their own."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks.holding"], capture_output=True, text=True, timeout=60, check=True
    )
    seconds, grown_mb = json.loads(done.stdout)
    assert seconds[0][0].startswith("hold (")
    if sys.platform == "linux":
        assert sum(mb for name, mb in grown_mb.items() if "hold (" in name) == pytest.approx(80.0, rel=0.3)


@pytest.mark.skipif(shutil.which("gcc") is None or sys.platform != "linux", reason="needs gcc and signals of Linux")
def test_a_sampled_command_says_what_it_says_alone(tmp_path: Path) -> None:
    commands = Commands(tmp_path)
    arguments = ("simulate", "as-built", "--help")
    ran = commands.sampled(*arguments)
    assert ran.out == commands.mccd(*arguments).out
    assert set(ran.seen) >= {"shares", "own_time", "grown_mb", "processor_s"}
    json.dumps(ran.seen, allow_nan=False)
