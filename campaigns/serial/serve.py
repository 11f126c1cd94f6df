"""Start an emulated bench: from options to a firmware, a port and a loop that ends with a signal or its parent."""

from __future__ import annotations

import itertools
import secrets
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from campaigns.serial.faults import parse_faults
from campaigns.serial.firmware import Firmware
from campaigns.serial.ports import Port, PtyPort, TcpPort
from campaigns.serial.server import Server
from sim_backend.bench import Bench, Segment
from sim_backend.errors import ConfigError

LOOPBACK = "127.0.0.1"

Say = Callable[[str], None]


class ServeOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How an emulated bench is served.

    `bench` is the simulated bench behind it. A pty gets the lasting name `link`. `baud` throttles the line,
    `speed` paces the bench (1: real time; none: as fast as it computes). `lifeline`: end when standard input does.
    """

    bench: str = "sim"
    seed: int = 0
    transport: Literal["pty", "tcp"] = "pty"
    host: str = LOOPBACK
    port: int = 0
    link: str | None = None
    baud: float | None = None
    speed: float | None = None
    faults: str | None = None
    lifeline: bool = False

    def __post_init__(self) -> None:
        for name in ("baud", "speed"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise ConfigError(f"emulated bench: {name} is {value}; it must be a finite number above zero")


def serve(options: ServeOptions, open_bench: Callable[[str, int], Bench], say: Say, journal: Say) -> None:
    """Serve until SIGINT, SIGTERM, SIGHUP or the end of the lifeline; leave the bench safe.

    `say` gets the address under which clients find it, `journal` one line per state that the bench enters. Raises
    ConfigError for options that cannot be, HardwareError for a port that cannot be had.
    """
    faults = None if options.faults is None else parse_faults(options.faults)
    _warm(open_bench(options.bench, options.seed))
    bench = open_bench(options.bench, options.seed)
    boots = (secrets.randbelow(2**31) for _ in itertools.count())
    started_s = time.monotonic()

    def note(state: str, why: str) -> None:
        journal(f"{time.monotonic() - started_s:10.3f} s  {state:8s} {why}")

    firmware = Firmware(bench, boots, speed=options.speed, journal=note)
    server = Server(firmware, _port(options), baud=options.baud, faults=faults)
    before = {number: signal.signal(number, server.stop) for number in _ENDING}
    try:
        say(server.address)
        server.run(sys.stdin.fileno() if options.lifeline else None)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    struck = ", ".join(f"{kind} {count}" for kind, count in server.faults_struck.items() if count)
    journal(f"{time.monotonic() - started_s:10.3f} s  ended    safe{f'; faults: {struck}' if struck else ''}")


def _warm(bench: Bench) -> None:
    """Let the first run ever compile before a client waits for it; on a bench apart, for playing draws noise."""
    still = np.zeros((1, len(bench.axes)))
    bench.play(Segment("warm", 1, still, still))
    bench.close()


_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def _port(options: ServeOptions) -> Port:
    if options.transport == "pty":
        return PtyPort(None if options.link is None else Path(options.link))
    return TcpPort(options.host, options.port)
