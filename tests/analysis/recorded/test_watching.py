"""The time that a growing log has left: told once rows have come twice, and right to a factor of two from then on."""

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import pytest

from analysis.recorded.watching import Watch
from tests import running

ROOT = Path(__file__).parents[3]
RATE_HZ, BLOCK, BLOCKS = 100.0, 1000, 12

# a writer is a process of its own: within one, HDF5 does not open a file twice
WRITER = f"""
import sys
import numpy as np
from campaigns.log import Channel, LogWriter
channel = Channel("theta_x", "rad", "output", "theta_x", {RATE_HZ})
with LogWriter.create(sys.argv[1], [channel], test="freerun", bench={{}}, expected_rows={BLOCK * BLOCKS}, note="warm",
                      chunk_rows=500) as log:
    log.begin_segment("all")
    print("ready", flush=True)
    for _ in sys.stdin:
        log.append({{"theta_x": np.zeros({BLOCK})}})
        print("written", flush=True)
    log.end_segment()
"""


class Writer:
    """Appends a block when it is told to."""

    def __init__(self, ask: IO[str], answer: IO[str]) -> None:
        self.ask, self.answer = ask, answer
        assert answer.readline() == "ready\n"

    def append(self) -> None:
        self.ask.write("\n")
        self.ask.flush()
        assert self.answer.readline() == "written\n"


@contextmanager
def written(path: Path) -> Iterator[Writer]:
    with subprocess.Popen(
        [*running.PYTHON, "-c", WRITER, str(path)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdin is not None and process.stdout is not None
        yield Writer(process.stdin, process.stdout)


def looks(path: Path, first_look_s: float, blocks_s: Sequence[float]) -> list[tuple[float, float | None]]:
    """Return (seconds that are left in truth, that are told) of looks every 0.5 s at a log that grows in blocks."""
    told, due_s = [], list(blocks_s)
    with written(path) as writer:
        watching, now_s = Watch(path), 0.0
        while due_s:
            while due_s and due_s[0] <= now_s:
                writer.append()
                del due_s[0]
            if now_s >= first_look_s and due_s:
                seen = watching.look(now_s)
                assert seen.note == "warm"
                told.append((blocks_s[-1] - now_s, seen.left_s))
            now_s += 0.5
    return told


def every(block_s: float, blocks: int = BLOCKS, begun_s: float = 0.0) -> list[float]:
    """Return the moments of blocks that come one after another."""
    return [begun_s + block_s * (k + 1) for k in range(blocks)]


@pytest.mark.parametrize(("first_look_s", "block_s"), [(0.0, 10.0), (9.5, 10.0), (23.0, 10.0), (1.0, 2.0)])
def test_the_time_left_of_a_log_that_grows_in_blocks_is_never_wrong_by_a_factor_of_two(tmp_path, first_look_s, block_s):
    told = looks(tmp_path / "run.h5", first_look_s, every(block_s))
    early = [left for true, left in told if true > BLOCKS * block_s - first_look_s - block_s]
    assert early and set(early) == {None}  # one block tells no rate
    known = [(true, left) for true, left in told if left is not None]
    assert len(known) > 0.5 * len(told)
    for true, left in known:
        assert 0.5 * true - 1.0 <= left <= 2.0 * true + 1.0


@pytest.mark.parametrize(("before_s", "after_s"), [(2.0, 20.0), (20.0, 2.0)], ids=["slower", "faster"])
def test_after_a_change_of_pace_no_wrong_time_is_told(tmp_path, before_s, after_s):
    half = BLOCKS // 2
    change_s = before_s * half
    moments = every(before_s, half) + every(after_s, BLOCKS - half, change_s)
    told = [(moments[-1] - true, true, left) for true, left in looks(tmp_path / "run.h5", 0.0, moments)]
    assert any(left is not None for now_s, _, left in told if now_s < change_s)
    # nobody can know of it before the next block has come, or should have
    seen_s = change_s + min(2.0 * before_s, after_s)
    for now_s, true, left in told:
        if now_s > seen_s and left is not None:
            assert 0.5 * true - 1.0 <= left <= 2.0 * true + 1.0, (now_s, true, left)


def test_rows_that_are_long_overdue_leave_the_time_unknown(tmp_path):
    with written(tmp_path / "run.h5") as writer:
        watching, left = Watch(tmp_path / "run.h5"), {}
        for now_s in range(60):
            if now_s in (10, 20):
                writer.append()
            left[now_s] = watching.look(float(now_s)).left_s
    assert left[19] is None and left[20] == pytest.approx(100.0) and left[29] == pytest.approx(91.0)
    assert left[41] is None
