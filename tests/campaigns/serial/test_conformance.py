"""The conformance test passes a bench that keeps to the protocol, and finds out one that does not."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from campaigns.serial import TcpTransport
from campaigns.serial.addresses import resolved
from campaigns.serial.answers import Reply, Upload
from campaigns.serial.conformance import CHECKS, check_bench
from campaigns.serial.firmware import Firmware
from campaigns.serial.frames import Line
from campaigns.serial.ports import TcpPort
from campaigns.serial.server import Server
from sim_backend.bench import Segment
from sim_backend.simbench import SimBench
from tests.campaigns.serial.conftest import Serve
from tests.small_bench import bench_model

Answer = Reply | Upload | None


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """Compile the loop before a check waits for it."""
    still = np.zeros((1, 3))
    SimBench(bench_model(), 1).play(Segment("warm", 1, still, still))


@contextmanager
def serving(firmware: Firmware) -> Iterator[TcpTransport]:
    """Serve a firmware of the test's own on a real port, from a thread."""
    port = TcpPort(resolved("127.0.0.1", 0)[0])
    server = Server(firmware, port)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield TcpTransport("127.0.0.1", int(port.address.rpartition(":")[2]))
    finally:
        server.stop()
        thread.join()


def failed(firmware: Firmware) -> set[str]:
    with serving(firmware) as transport:
        return {result.name for result in check_bench(transport) if not result.ok}


class Bent(Firmware):
    """Firmware in which one answer is bent."""

    def __init__(self, bend: Callable[[str, Answer], Answer]) -> None:
        super().__init__(SimBench(bench_model(), 1), itertools.count(1))
        self._bend = bend

    def handle(self, line: Line, holder: str | None, now_s: float) -> Answer:
        return self._bend(line.text, super().handle(line, holder, now_s))


def reply_if(holds: bool, text: str, otherwise: Answer) -> Answer:
    return Reply(text) if holds else otherwise


@pytest.mark.parametrize("transport", ["pty", "tcp"])
def test_the_emulated_bench_passes(serve: Serve, transport: str) -> None:
    results = check_bench(serve(transport=transport).process.transport())
    assert [r.name for r in results] == list(CHECKS)
    assert [(r.name, r.detail) for r in results if not r.ok] == []


def test_a_firmware_without_watchdog_is_found_out() -> None:
    class Careless(Firmware):
        def tick(self, now_s: float) -> None:
            self.hear(now_s)
            super().tick(now_s)

    found = failed(Careless(SimBench(bench_model(), 1), itertools.count(1)))
    assert found == {"watchdog", "watchdog and other clients"}


def test_a_firmware_that_anybody_keeps_awake_is_found_out() -> None:
    class Obliging(Firmware):
        def handle(self, line: Line, holder: str | None, now_s: float) -> Answer:
            self.hear(now_s)
            return super().handle(line, holder, now_s)

    assert failed(Obliging(SimBench(bench_model(), 1), itertools.count(1))) == {"watchdog and other clients"}


BENT: dict[str, tuple[Callable[[str, Answer], Answer], set[str]]] = {
    "takes any lock": (lambda text, a: reply_if(text == "SYST:LOCK somebodyelse", "OK 1,0", a), {"lock"}),
    "arms whatever the epoch": (
        lambda text, a: reply_if(text.startswith("ARM") and isinstance(a, Reply) and "made safe" in a.text, "OK", a),
        {"arming after a safe state"},
    ),
    "keeps no limits": (
        lambda text, a: reply_if(text.startswith("ARM") and isinstance(a, Reply) and "ERR -222" in a.text, "OK", a),
        {"limits are kept", "image that is none"},
    ),
    "forgets its errors": (
        lambda text, a: reply_if(text == "SYST:ERR?", '0,"No error"', a),
        {"error queue", "commands need a checksum", "watchdog"},
    ),
    "starts what is not armed": (
        lambda text, a: reply_if(text.startswith("INIT"), "OK", a),
        {"start without arming"},
    ),
    "answers nonsense": (
        lambda text, a: reply_if(text.startswith("REC?"), "a,b,c,d", a),
        {"states and repetition", "download", "line closed and opened"},
    ),
}


@pytest.mark.parametrize("fault", BENT)
def test_a_firmware_that_bends_the_rules_is_found_out(fault: str) -> None:
    bend, expected = BENT[fault]
    assert failed(Bent(bend)) == expected
