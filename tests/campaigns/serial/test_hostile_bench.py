"""A host against benches that it cannot trust: every answer is bounded in time and bytes, and ends in a clear error."""

from __future__ import annotations

import contextlib
import json
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from campaigns.serial import SerialBench, TcpTransport, conformance, transport_at
from campaigns.serial import link as linking
from campaigns.serial.answers import Reply
from campaigns.serial.conformance import check_bench
from campaigns.serial.description import decode_description, describe, encode_description
from campaigns.serial.link import REPLY_S, Link
from campaigns.serial.transport import LinkLost
from sim_backend.errors import HardwareError
from sim_backend.simbench import SimBench
from tests.campaigns.serial.conftest import noise_segment
from tests.campaigns.serial.hostile import BentFirmware, dripping, served
from tests.small_bench import bench_model

DRIP_S = 0.2


def drip_after(header: str, piece: bytes = b"#") -> Callable[[str, Reply], Reply]:
    """Answer `header` as announced, and then drip in place of the blocks."""
    return lambda text, answer: Reply(answer.text, dripping(piece, DRIP_S)) if text.startswith(header) else answer


@pytest.mark.parametrize("transport", ["pty", "tcp"])
def test_blocks_that_drip_in_are_given_up_in_time(tmp_path: Path, transport: str) -> None:
    """A byte every 0.2 s is never silent for long enough to count as loss: a block alone would take 209 s."""
    firmware = BentFirmware(SimBench(bench_model(), 1), drip_after("SYST:DESC? "))
    with served(firmware, tmp_path / "tty" if transport == "pty" else None) as address:
        kind, _, rest = address.partition(":")
        link = Link(transport_at(kind, f"{rest}@4000000" if kind == "serial" else rest))
        with contextlib.closing(link):
            link.open()
            link.limit(1.0)
            started_s = time.monotonic()
            with pytest.raises(HardwareError, match="time is up while waiting for"):
                link.download("SYST:DESC?", 0, 900_000, 0)
            assert time.monotonic() - started_s < 1.0 + REPLY_S


def test_a_bench_check_of_a_bench_that_drips_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    firmware = BentFirmware(SimBench(bench_model(), 1), drip_after("REC:DATA?"))
    monkeypatch.setattr(conformance, "CHECKS", {"download": conformance.CHECKS["download"]})
    monkeypatch.setattr(conformance, "CHECK_S", 1.0)
    with served(firmware) as address:
        started_s = time.monotonic()
        results = check_bench(transport_at("tcp", address.removeprefix("tcp:")))
        assert time.monotonic() - started_s < 6.0
    assert [(r.ok, "time is up" in r.detail) for r in results] == [(False, True)]


def bench_at(address: str) -> SerialBench:
    return SerialBench(transport_at("tcp", address.removeprefix("tcp:")), "tcp", watchdog_s=0.2)


@contextlib.contextmanager
def flooding(piece: bytes) -> Iterator[int]:
    """Serve lines on which `piece` is repeated without end, whatever is asked; yield the port."""
    listening = socket.create_server(("127.0.0.1", 0))
    over = threading.Event()

    def flood(line: socket.socket) -> None:
        with line, contextlib.suppress(OSError):
            line.settimeout(0.2)
            while not over.is_set():
                with contextlib.suppress(TimeoutError):
                    line.send(piece)

    def accept() -> None:
        with contextlib.suppress(OSError):
            while True:
                threads.append(threading.Thread(target=flood, args=(listening.accept()[0],)))
                threads[-1].start()

    threads = [threading.Thread(target=accept)]
    threads[0].start()
    try:
        yield listening.getsockname()[1]
    finally:
        over.set()
        listening.shutdown(socket.SHUT_RDWR)
        for thread in threads:
            thread.join()
        listening.close()


def test_a_flood_is_bounded_in_bytes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linking, "_MOST_BYTES", 1 << 20)
    with flooding(b"x" * 65536) as port:
        transport = TcpTransport("127.0.0.1", port)
        link = Link(transport)
        transport.open(1.0)
        with contextlib.closing(link), pytest.raises(LinkLost, match="sends without end"):
            link.exchange("STAT?")


@pytest.mark.parametrize("piece", [b"x" * 65536, b"\n" * 65536, b"\xff\n" * 30000, b"running,1,2,3\n" * 4000])
def test_a_flood_is_bounded_in_time(monkeypatch: pytest.MonkeyPatch, piece: bytes) -> None:
    monkeypatch.setattr(linking, "OPEN_S", 0.5)
    monkeypatch.setattr(linking, "TRIES", 1)
    with flooding(piece) as port:
        started_s = time.monotonic()
        with pytest.raises(HardwareError, match="sends without end|does not answer|was lost|hung up"):
            SerialBench(TcpTransport("127.0.0.1", port), "tcp")
        assert time.monotonic() - started_s < 4.0


def test_a_terminal_that_drips_garbage_is_no_bench(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linking, "OPEN_S", 0.5)
    monkeypatch.setattr(linking, "TRIES", 1)
    master, slave = os.openpty()
    over = threading.Event()

    def drip() -> None:
        while not over.wait(0.02):
            os.write(master, b"?")

    thread = threading.Thread(target=drip)
    thread.start()
    try:
        started_s = time.monotonic()
        with pytest.raises(HardwareError, match="does not answer"):
            SerialBench(transport_at("serial", f"{os.ttyname(slave)}@4000000"), "serial")
        assert time.monotonic() - started_s < 4.0
    finally:
        over.set()
        thread.join()
        os.close(master)
        os.close(slave)


DOCUMENT = encode_description(
    describe(SimBench(bench_model(), 1), travel_factor=2.0, current_factor=1.05, memory_bytes=10**6)
)


def channel(**fields: object) -> Callable[[dict[str, Any]], object]:
    return lambda document: document["channels"][1].update(fields)


WRONG: dict[str, Callable[[dict[str, Any]], object]] = {
    "names twice": channel(name="command_theta_x"),
    "no name": channel(name=""),
    "a path as a name": channel(name="../x"),
    "a terminal's command as a name": channel(name="\x1b[2J"),
    "a control sign in a unit": channel(unit="\0"),
    "an endless unit": channel(unit="u" * 70_000),
    "a control sign in a degree of freedom": channel(dof="\0"),
    "axes twice": lambda d: d.update(axes=["z", "z", "z"]),
    "an axis without a name": lambda d: d.update(axes=["x", "", "z"]),
    "a tiny rate": lambda d: d.update(rate_hz=1e-300),
    "a huge rate": lambda d: d.update(rate_hz=1e300),
    "a rate below zero": lambda d: d.update(rate_hz=-1e4),
    "no memory": lambda d: d.update(memory_bytes=0),
    "a reference below zero": lambda d: d.update(reference=[-1.0, 1.0, 1.0]),
    "a current below zero": lambda d: d.update(current_a=-1.0),
    "a current that trips below its limit": lambda d: d.update(trip_current_a=0.5 * d["current_a"]),
    "an axis that trips within its reach": lambda d: d.update(travel=[0.5 * r for r in d["reference"]]),
    "a coil of no force": lambda d: d["coil"].update(force_constant_n_a=0.0),
    "limits of other axes": lambda d: d.update(travel=[1.0]),
    "a ragged table": lambda d: d.update(to_current=[[1.0, 2.0]]),
    "no outputs": lambda d: [c.update(role="aux") for c in d["channels"] if c["role"] == "output"],
    "no inputs": lambda d: [c.update(role="aux") for c in d["channels"] if c["role"] == "input"],
    "another schema": lambda d: d.update(schema="mccd-bench/9"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_a_description_that_cannot_be(kind: str) -> None:
    document = json.loads(DOCUMENT)
    WRONG[kind](document)
    with pytest.raises(HardwareError, match=r"description cannot be (right|read)") as error:
        decode_description(json.dumps(document).encode())
    assert str(error.value).isprintable() and len(str(error.value)) < 300


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"{}",
        b"[" * 100_000,
        DOCUMENT.replace(b'{"schema"', b'{"x":' + b"[" * 9000 + b"]" * 9000 + b',"schema"', 1),
        DOCUMENT.replace(b'"axes"', b'"ax\xff"', 1),
        DOCUMENT.replace(b'"rate_hz":10000.0', b'"rate_hz":1e999'),
        DOCUMENT.replace(b'"rate_hz":10000.0', b'"rate_hz":NaN'),
        DOCUMENT.replace(b'"command_theta_y"', b'"\\ud800"', 1),
    ],
)
def test_a_description_that_cannot_be_read(text: bytes) -> None:
    with pytest.raises(HardwareError, match="description cannot be read"):
        decode_description(text)


def test_a_right_description_passes() -> None:
    assert encode_description(decode_description(DOCUMENT)) == DOCUMENT


ANSWERS = ["", "nan", "-1", "1e9", "9" * 400, "running", "running,1,2,3", "OK", "OK nan", 'ERR x,"y"', "ERR", "a,b,c,d"]


@pytest.mark.parametrize(
    "header", ["STAT?", "REC?", "REC:DATA?", "SYST:DESC?", "SYST:LOCK", "ABOR", "*IDN?", "SEGM:BEG"]
)
def test_answers_that_are_none(header: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linking, "REPLY_S", 0.2)
    monkeypatch.setattr(linking, "OPEN_S", 0.2)
    answers = iter(ANSWERS)
    now = [""]

    def bend(text: str, answer: Reply) -> Reply:
        return Reply(now[0]) if text.startswith(header) else answer

    firmware = BentFirmware(SimBench(bench_model(), 1), bend)
    with served(firmware) as address:
        for now[0] in answers:
            with contextlib.suppress(HardwareError):
                with contextlib.closing(bench_at(address)) as bench:
                    bench.play(noise_segment("a", 10))
            firmware.restart()  # the lock of a host that gave up would fall to the next one after the watchdog's time
