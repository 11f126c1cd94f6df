"""The client on a real line to a real process: the same record bit for bit, clear errors, as fast as the line."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from campaigns.benches import BENCHES, open_bench
from campaigns.serial import SerialBench, transport_at
from campaigns.serial.client import WATCHDOG_S
from campaigns.serial.server import CREDIT_S
from sim_backend.bench import Segment
from sim_backend.errors import ConfigError, HardwareError
from sim_backend.model import load_model
from sim_backend.simbench import SimBench
from tests.campaigns.serial.conftest import Serve, differences, loop_segments, noise_segment


@contextlib.contextmanager
def client(address: str, watchdog_s: float = WATCHDOG_S) -> Iterator[SerialBench]:
    kind, _, rest = address.partition(":")
    bench = SerialBench(transport_at(kind, rest), kind, watchdog_s=watchdog_s)
    try:
        yield bench
    finally:
        bench.close()


@pytest.mark.parametrize("transport", ["pty", "tcp"])
def test_the_record_is_that_of_the_bench_itself(serve: Serve, model_path: str, transport: str) -> None:
    served = serve(transport=transport)
    direct = SimBench(load_model(model_path), 5)
    with client(served.address) as bench:
        for segment in loop_segments():
            got = bench.play(segment)
            assert got.segment is segment
            assert differences(got, direct.play(segment)) == []
        assert bench.retries == 0
        bench.safe()
        direct.safe()
        segment = noise_segment("after the safe state", 300)
        assert differences(bench.play(segment), direct.play(segment)) == []
        # and that the comparison can tell: the next record of the same segment has other noise
        assert differences(bench.play(segment), SimBench(load_model(model_path), 5).play(segment)) != []


def test_its_face_is_that_of_the_bench_itself(serve: Serve, model_path: str) -> None:
    direct = SimBench(load_model(model_path), 5, name="small")
    with client(serve().address) as bench:
        assert (bench.axes, bench.signals) == (direct.axes, direct.signals)
        for name in ("reference", "current_a", "to_current"):
            np.testing.assert_array_equal(getattr(bench.limits, name), getattr(direct.limits, name))
        assert replace(bench.identity, kind="sim") == direct.identity


@pytest.mark.usefixtures("started")
def test_the_emulator_by_its_address(model_path: str) -> None:
    bench, direct = open_bench(f"emulator:{model_path}", 8), open_bench(f"sim:{model_path}", 8)
    segment = noise_segment("a", 400)
    assert differences(bench.play(segment), direct.play(segment)) == []
    assert bench.identity.kind == "emulator"
    process = bench.emulator.process  # type: ignore[attr-defined]
    bench.close()
    assert process.wait(10) == 0
    assert BENCHES["emulator"].repeatable and not BENCHES["tcp"].repeatable


def test_what_a_bench_cannot_be_asked_is_refused_before_anything_is_sent(serve: Serve) -> None:
    served = serve()
    with client(served.address) as bench:
        good = noise_segment("a", 10)
        bad = [
            (replace(good, reference=good.reference + 1.0), "end stop"),
            (replace(good, record=("w",)), "no channel 'w'"),
            (replace(good, n_samples=10**9), "the bench has room for"),
        ]
        for segment, message in bad:
            with pytest.raises(ConfigError, match=message):
                bench.play(segment)
        loop = loop_segments()[1]
        pi = loop.feedback[0]
        assert pi is not None
        with pytest.raises(ConfigError, match=r"controllers for \[5000.0\] Hz; this bench runs at 10000 Hz"):
            bench.play(replace(loop, feedback=(replace(pi, rate_hz=5000.0),), learning=()))
        assert "running" not in " ".join(served.journal)
        bench.play(good)


def test_a_bench_that_belongs_to_another_host(serve: Serve) -> None:
    served = serve(transport="tcp")
    with client(served.address) as bench:
        with pytest.raises(HardwareError, match="another host holds the bench"), client(served.address):
            pass
        bench.play(noise_segment("a", 10))
    with client(served.address) as bench:  # unlocked by the first one's end
        bench.play(noise_segment("b", 10))


def test_a_serial_port_is_for_one_process_alone(serve: Serve) -> None:
    served = serve()
    with client(served.address), pytest.raises(HardwareError, match="cannot be opened"):
        SerialBench(transport_at("serial", served.address.partition(":")[2]), "serial")


@pytest.mark.parametrize("address", ["serial:/dev/no-such-device", "tcp:127.0.0.1:9"])
def test_a_bench_that_is_not_there(address: str) -> None:
    started_s = time.monotonic()
    with pytest.raises(HardwareError, match="cannot be (opened|reached)"), client(address):
        pass
    assert time.monotonic() - started_s < 8.0  # OPEN_S, and one attempt that has begun before


def test_a_line_on_which_nobody_answers() -> None:
    master, slave = os.openpty()
    try:
        started_s = time.monotonic()
        with pytest.raises(HardwareError, match="does not answer"), client(f"serial:{os.ttyname(slave)}@4000000"):
            pass
        assert time.monotonic() - started_s < 27.0  # as derived in benchmarks/soak_serial.py for one step
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize(
    ("address", "says"),
    [
        ("serial:", "names no device"),
        ("serial:/dev/x@fast", "has the baud rate 'fast'; it must be a whole number from 1 to 100000000"),
        ("serial:/dev/x@0", "has the baud rate '0'; it must be a whole number from 1 to 100000000"),
        ("tcp:5025", "names no host"),
        ("tcp:host:0", "has the port '0'; it must be a whole number from 1 to 65535"),
        ("tcp:host:99999", "has the port '99999'; it must be a whole number from 1 to 65535"),
    ],
)
def test_addresses_that_are_none(address: str, says: str) -> None:
    with pytest.raises(ConfigError, match=f"^{address} {says}"):
        open_bench(address, 0)


def test_a_bench_made_safe_by_somebody_else_is_noticed(serve: Serve) -> None:
    served = serve(transport="tcp")
    with client(served.address) as bench:
        bench.play(noise_segment("a", 10))
        stranger = transport_at("tcp", served.address.partition(":")[2])
        stranger.open(1.0)
        stranger.write(b"abort\n", 1.0)
        assert b"OK" in stranger.read(2.0)
        stranger.close()
        with pytest.raises(HardwareError, match="went to its safe state"):
            bench.play(noise_segment("b", 10))
        bench.safe()
        bench.play(noise_segment("c", 10))


def test_a_host_that_is_silent_between_segments_is_told_so(serve: Serve) -> None:
    served = serve()
    with client(served.address, watchdog_s=0.3) as bench:
        bench.play(noise_segment("a", 10))
        time.sleep(0.8)
        assert served.state == "fault"
        with pytest.raises(HardwareError, match=r"segment 'b': .*watchdog: the host was silent"):
            bench.play(noise_segment("b", 10))


def test_time_in_which_the_emulated_bench_had_no_turn_is_not_a_hosts_silence(
    serve: Serve, started: None, model_path: str
) -> None:
    """A busy machine may keep its process waiting; what the host has sent meanwhile lies unread."""
    served = serve(transport="tcp")
    direct = SimBench(load_model(model_path), 5)
    with client(served.address, watchdog_s=1.0) as bench:
        first, second = loop_segments()[:2]
        assert differences(bench.play(first), direct.play(first)) == []
        process = served.process.process.pid
        os.kill(process, signal.SIGSTOP)
        threading.Timer(2.0, os.kill, (process, signal.SIGCONT)).start()
        assert differences(bench.play(second), direct.play(second)) == []
        assert bench.retries > 0


def test_a_host_that_waits_for_a_lost_answer_is_not_silent(serve: Serve, model_path: str) -> None:
    """Here and there a request is damaged, and its answer is waited for longer than the watchdog waits."""
    served = serve(transport="tcp", faults="3/flip=1.5e-4")
    direct = SimBench(load_model(model_path), 5)
    with client(served.address, watchdog_s=0.7) as bench:
        for segment in loop_segments()[:2]:
            assert differences(bench.play(segment), direct.play(segment)) == []
        assert bench.retries > 0


def test_a_download_goes_on_where_the_line_was_lost(serve: Serve, model_path: str) -> None:
    """Two megabytes at 4 Mbaud take five seconds; a drop every 300 kB on average falls into most of them."""
    served = serve(transport="tcp", faults="11/drop=3e-6")
    direct = SimBench(load_model(model_path), 5)
    segment = noise_segment("long", 30_000)
    with client(served.address) as bench:
        assert differences(bench.play(segment), direct.play(segment)) == []
    served.process.close()
    assert "drop" in served.journal[-1]
    sent = sum(line.startswith("running") for line in served.journal)
    assert sent == 1  # the segment was not played again


@pytest.mark.parametrize("transport", ["pty", "tcp"])
def test_throughput_is_that_of_the_line(serve: Serve, transport: str) -> None:
    """A segment from its upload to its record, all questions included, in at most a ninth more than its bytes take."""
    baud = 230_400
    served = serve(transport=transport, baud=baud)
    kind, _, rest = served.address.partition(":")
    with client(f"{kind}:{rest}@{baud}" if kind == "serial" else served.address) as bench:
        bench.play(noise_segment("warm", 10))
        segment = noise_segment("measured", 4500, ("theta_x", "theta_y", "z"))
        size = 8 * 4500 * 3 + 8 * 500 * 3  # the record, and the feed-forward; a reference of zero takes nothing
        # in either direction the throttle lends what a line lets pass in CREDIT_S: that is counted as time;
        # what else the machine does only adds time, so the best of a few counts
        shares = (size / (baud / 10) / (seconds(bench, segment) + 2 * CREDIT_S) for _ in range(4))
        best = next((share for share in shares if share >= 0.9), 0.0)
    assert 0.9 <= best <= 1.0


def seconds(bench: SerialBench, segment: Segment) -> float:
    started_s = time.monotonic()
    bench.play(segment)
    return time.monotonic() - started_s
