"""Interrupted, ended and killed hosts: real signals, real processes, and what the bench itself says of it."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import pytest

from campaigns.serial import SerialBench, transport_at
from campaigns.serial.client import WATCHDOG_S
from sim_backend.errors import HardwareError
from tests.campaigns.serial.conftest import Serve, Served
from tests.running import PYTHON

ROOT = Path(__file__).parents[3]
Start = Callable[[Served, float], subprocess.Popen[str]]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Return a function that starts a host; what is still alive after the test is killed."""
    started: list[subprocess.Popen[str]] = []

    def begin(served: Served, segment_s: float) -> subprocess.Popen[str]:
        host = subprocess.Popen(
            [*PYTHON, *words(served, tmp_path, segment_s)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        started.append(host)
        return host

    yield begin
    for host in started:
        host.kill()
        host.communicate()


def words(served: Served, folder: Path, segment_s: float) -> list[str]:
    return ["-m", "tests.campaigns.serial.host", served.address, str(folder / "run.h5"), str(segment_s)]


def wait_for(host: subprocess.Popen[str], line: str) -> None:
    assert host.stdout is not None and host.stderr is not None
    for said in host.stdout:
        if said.strip() == line:
            return
    raise AssertionError(f"never said '{line}': {host.stderr.read()}")


def wait_until(holds: Callable[[], bool], within_s: float) -> bool:
    end_s = time.monotonic() + within_s
    while not holds():
        if time.monotonic() > end_s:
            return False
        time.sleep(0.02)
    return True


def status_of(folder: Path) -> str:
    with h5py.File(folder / "run.h5") as file:
        return str(file.attrs["status"])


def test_the_first_interrupt_finishes_the_segment_and_saves(serve: Serve, start: Start, tmp_path: Path) -> None:
    served = serve(speed=1.0)
    host = start(served, 0.5)
    wait_for(host, "playing 3")
    host.send_signal(signal.SIGINT)
    said, _ = host.communicate(timeout=30)
    assert said.splitlines()[-1] == "paused" and host.returncode == 0
    with h5py.File(tmp_path / "run.h5") as file:
        assert file.attrs["status"] == "paused"
        assert file["committed_rows"][()] == 3 * 5000
    assert served.state == "idle"
    assert sum(line.startswith("done") and "upload" not in line for line in served.journal) == 3


@pytest.mark.parametrize("signals", [(signal.SIGINT, signal.SIGINT), (signal.SIGTERM,), (signal.SIGHUP,)])
def test_a_second_interrupt_or_termination_makes_the_bench_safe_at_once(
    serve: Serve, start: Start, tmp_path: Path, signals: tuple[signal.Signals, ...]
) -> None:
    served = serve(speed=1.0)
    host = start(served, 60.0)
    assert wait_until(lambda: served.state == "running", 30.0)
    for number in signals[:-1]:
        host.send_signal(number)
        time.sleep(0.5)
        assert served.state == "running"
    host.send_signal(signals[-1])
    # well before the watchdog would do it
    assert wait_until(lambda: served.state == "idle", WATCHDOG_S - 1.0)
    assert served.journal[-1].endswith("abort")
    host.communicate(timeout=30)
    assert host.returncode != 0
    assert status_of(tmp_path) == "aborted"


def test_a_closed_terminal_makes_the_bench_safe(serve: Serve, tmp_path: Path) -> None:
    served = serve(speed=1.0)
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(ROOT)
        os.execv(sys.executable, [sys.executable, *words(served, tmp_path, 60.0)])
    try:
        assert wait_until(lambda: served.state == "running", 30.0)
        os.close(terminal)
        assert wait_until(lambda: served.state == "idle", WATCHDOG_S - 1.0)
        assert served.journal[-1].endswith("abort")
    finally:
        if not wait_until(lambda: os.waitpid(child, os.WNOHANG) != (0, 0), 20.0):
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
    assert status_of(tmp_path) == "aborted"


@pytest.mark.parametrize("transport", ["pty", "tcp"])
def test_a_killed_host_is_caught_by_the_watchdog(serve: Serve, start: Start, transport: str) -> None:
    served = serve(speed=1.0, transport=transport)
    host = start(served, 60.0)
    assert wait_until(lambda: served.state == "running", 30.0)
    host.kill()
    killed_s = time.monotonic()
    assert wait_until(lambda: served.state == "fault", WATCHDOG_S + 2.0)
    # its last words may be half a second old, and the poll of the journal takes its time
    assert time.monotonic() - killed_s > WATCHDOG_S - 1.0
    assert "watchdog: the host was silent for more than 5 s" in served.journal[-1]


def test_hosts_that_knock_at_once_do_not_keep_a_killed_hosts_bench_awake(serve: Serve, start: Start) -> None:
    """The next host has the same serial line; until the watchdog has acted it is refused, and then it is not."""
    served = serve(speed=1.0)
    host = start(served, 0.5)
    wait_for(host, "playing 2")
    host.kill()
    host.communicate()
    line = served.address.partition(":")[2]
    end_s, refusals, bench = time.monotonic() + WATCHDOG_S + 10.0, 0, None
    while bench is None and time.monotonic() < end_s:
        try:
            bench = SerialBench(transport_at("serial", f"{line}@4000000"), "serial")
        except HardwareError as error:
            assert "another host holds the bench" in str(error)
            refusals += 1
            time.sleep(0.2)
    assert bench is not None and refusals > 3
    bench.close()
    assert any(entry.startswith("fault") and "watchdog" in entry for entry in served.journal)
