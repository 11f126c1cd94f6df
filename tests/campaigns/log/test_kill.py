"""`kill -9` of a real writer at random moments: every file opens, every row that was reported as committed is there."""

import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from campaigns.log import read_run, recover, verify

# Writes run after run, each of random length, so that a kill meets creation, appending and closing alike. Every value
# tells its row and its channel. Each line on stdout: file, committed rows.
WRITER = """
import random, sys
import numpy as np
from campaigns.log import Channel, LogWriter

folder, seed = sys.argv[1], int(sys.argv[2])
rng = random.Random(seed)
names = [f"c{index}" for index in range(6)]
channels = [Channel(name, "rad", "output", "z", 1e4) for name in names]
for number in range(10**6):
    path = f"{folder}/run{number}.h5"
    with LogWriter.create(path, channels, test="kill", bench={}, chunk_rows=256) as log:
        for part in range(rng.randrange(1, 8)):
            with log.segment(f"part {part}", {"part": part}):
                for _ in range(rng.randrange(1, 30)):
                    row = log.rows + np.arange(rng.randrange(1, 600), dtype=float)
                    log.append({name: row + 1e9 * index for index, name in enumerate(names)})
                    print(path, log.committed_rows, flush=True)
    print(path, log.rows, flush=True)
"""


def kill_one(folder: Path, seed: int) -> int:
    """Start a writer, kill it at a random moment, check all that it left; return the number of its runs."""
    folder.mkdir()
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(folder), str(seed)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert writer.stdout is not None and writer.stderr is not None
    first = writer.stdout.readline()
    time.sleep(random.Random(seed).uniform(0.0, 0.15))
    writer.kill()
    rest, errors = writer.communicate(timeout=60)
    assert errors == ""
    reported: dict[str, int] = {}
    whole, _, _ = (first + rest).rpartition("\n")  # the kill may have cut the last line
    for line in whole.splitlines():
        path, rows = line.split()
        reported[path] = int(rows)
    found = sorted(folder.glob("*.h5"))
    assert {str(path) for path in found} >= set(reported)
    unfinished = [path for path in found if not check_one(path, reported.get(str(path), 0), folder)]
    assert len(unfinished) <= 1
    return len(found)


def check_one(path: Path, reported: int, folder: Path) -> bool:
    """Check one run; return whether it was closed."""
    with read_run(path) as run:
        assert run.rows >= reported
        for index, name in enumerate(run.channels):
            np.testing.assert_array_equal(run.read(name), np.arange(run.rows) + 1e9 * index)
        for number, part in enumerate(run.segments):
            assert (part.label, part.settings) == (f"part {number}", {"part": number})
        covered = sum(part.rows for part in run.segments)
        assert covered == run.rows  # the writer leaves no gaps, so the segments tell of every row
        closed, rows = run.status == "complete", run.rows
        assert closed or run.status == "crashed"
    if not closed and rows:
        saved = recover(path, folder / f"saved-{path.name}.copy")
        assert saved.rows == rows and verify(saved.path).ok
    return closed


@pytest.mark.parametrize("seed", range(6))
def test_a_killed_writer_leaves_every_committed_row(tmp_path, seed):
    kill_one(tmp_path / "runs", seed)


@pytest.mark.soak
def test_two_hundred_killed_writers(tmp_path):
    runs = sum(kill_one(tmp_path / f"runs{seed}", 1000 + seed) for seed in range(200))
    assert runs >= 200
