"""Real signals to real processes: what a run leaves behind, and that the bench is made safe."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path

import h5py
import pytest

from campaigns.playing.interrupts import Interrupts, Terminated
from tests import running

ROOT = Path(__file__).parents[3]
SEGMENTS = 10


@pytest.fixture
def start(tmp_path):
    """Return a function that starts a run into `run.h5`; what is still alive after the test is killed."""
    started = []

    def begin(slow_s: float) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [*running.PYTHON, "-m", "tests.campaigns.playing.slow_run", "run", str(tmp_path / "run.h5"), "-"],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"SLOW_S": str(slow_s)},
        )
        started.append(process)
        return process

    yield begin
    for process in started:
        process.kill()
        process.communicate()


def wait_for(process: subprocess.Popen[str], line: str) -> None:
    assert process.stdout is not None and process.stderr is not None
    for said in process.stdout:
        if said.strip() == line:
            return
    raise AssertionError(f"never said '{line}': {process.stderr.read()}")


def end(process: subprocess.Popen[str]) -> list[str]:
    """Return the words it still says, but for what it plays."""
    said, _ = process.communicate(timeout=30)
    return [line for line in said.splitlines() if not line.startswith(("playing", "waiting"))]


def test_first_interrupt_finishes_the_segment_and_saves(tmp_path, start):
    process = start(slow_s=0.3)
    wait_for(process, "waiting 30 Hz")
    process.send_signal(signal.SIGINT)
    assert end(process) == ["safe", "paused"]
    assert process.returncode == 0
    with h5py.File(tmp_path / "run.h5") as file:
        assert file.attrs["status"] == "paused"
        assert f"segment 3 of {SEGMENTS}" in file.attrs["status_reason"]
        assert len(file["segments"]) == 3
        assert file["committed_rows"][()] == file["segments"]["stop", 2]


@pytest.mark.parametrize("signals", [(signal.SIGINT, signal.SIGINT), (signal.SIGTERM,), (signal.SIGHUP,)])
def test_second_interrupt_or_termination_aborts_at_once_and_safely(tmp_path, start, signals):
    # far longer than the test may take: only an abort within the segment ends it in time
    process = start(slow_s=60.0)
    wait_for(process, "waiting 10 Hz")
    for number in signals[:-1]:
        process.send_signal(number)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=0.5)
    process.send_signal(signals[-1])
    assert end(process) == ["safe"]
    assert process.returncode != 0
    with h5py.File(tmp_path / "run.h5") as file:
        assert file.attrs["status"] == "aborted"


def test_killed_process_leaves_a_readable_log(tmp_path, start):
    process = start(slow_s=0.2)
    wait_for(process, "waiting 40 Hz")
    process.kill()
    process.communicate(timeout=30)
    with h5py.File(tmp_path / "run.h5") as file:
        assert file.attrs["status"] == "running"
        committed = int(file["committed_rows"][()])
        # three segments of at least 6000 samples were handed over, in chunks of 4096 rows
        assert committed >= 3 * 6000 - 4096
        for name in file["channels"]:
            assert file["channels"][name][:committed].size == committed


def test_an_abort_waits_until_it_may_happen():
    with pytest.raises(Terminated), Interrupts() as signals:
        signal.raise_signal(signal.SIGTERM)
        reached = True
        with signals.abortable():
            reached = False
    assert reached


def test_an_abort_that_was_never_allowed_is_not_lost():
    with pytest.raises(KeyboardInterrupt), Interrupts() as signals:
        signal.raise_signal(signal.SIGINT)
        assert signals.pausing
        signal.raise_signal(signal.SIGINT)


def test_handlers_are_put_back():
    before = signal.getsignal(signal.SIGINT)
    with Interrupts():
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before
