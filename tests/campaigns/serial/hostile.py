"""Benches that no host can trust, on real lines: they drip, or say of themselves and their sensors what cannot be.

`Server` asks a session for its next bytes again and again, so blocks that come out empty are a pause on the line.
"""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from campaigns.serial.addresses import resolved
from campaigns.serial.answers import Reply, Upload
from campaigns.serial.firmware import Firmware
from campaigns.serial.frames import Line
from campaigns.serial.ports import Port, PtyPort, TcpPort
from campaigns.serial.server import Server
from sim_backend.bench import Array, Bench, Record, Segment

Bend = Callable[[str, Reply], Reply]
BendReading = Callable[[str, Array], Array]


class BentBench:
    """A bench whose readings are bent, channel by channel."""

    def __init__(self, bench: Bench, bend: BendReading) -> None:
        self._bench, self._bend = bench, bend

    def __getattr__(self, name: str) -> object:
        return getattr(self._bench, name)

    def play(self, segment: Segment) -> Record:
        channels = self._bench.play(segment).channels
        return Record(segment, {name: self._bend(name, values.copy()) for name, values in channels.items()})


class BentFirmware(Firmware):
    """Firmware without interlocks whose answers, and whose description, are bent."""

    def __init__(self, bench: object, bend: Bend, document: Callable[[bytes], bytes] = bytes) -> None:
        super().__init__(bench, itertools.count(1), travel_factor=np.inf, current_factor=np.inf)  # type: ignore[arg-type]
        self._bend = bend
        self._document = document(self._document)

    def handle(self, line: Line, holder: str | None, now_s: float) -> Reply | Upload | None:
        answer = super().handle(line, holder, now_s)
        return self._bend(line.text, answer) if isinstance(answer, Reply) else answer


def faithful(_text: str, answer: Reply) -> Reply:
    """Bend nothing."""
    return answer


def dripping(piece: bytes, every_s: float) -> Iterator[bytes]:
    """Yield a piece now and then, without end."""
    next_s = time.monotonic()
    while True:
        if time.monotonic() < next_s:
            yield b""
        else:
            next_s += every_s
            yield piece


@contextlib.contextmanager
def served(firmware: Firmware, link: Path | None = None) -> Iterator[str]:
    """Serve from a thread, over TCP or at the terminal `link`; yield the address."""
    port: Port = TcpPort(resolved("127.0.0.1", 0)[0]) if link is None else PtyPort(link)
    server = Server(firmware, port)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield port.address
    finally:
        server.stop()
        thread.join()
