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

from campaigns.serial.addresses import is_loopback, resolved
from campaigns.serial.faults import FaultSpec, parse_faults
from campaigns.serial.firmware import Firmware
from campaigns.serial.ports import Port, PtyPort, TcpPort
from campaigns.serial.server import Server
from campaigns.serial.shared_token import TOKEN, shared_token
from sim_backend.bench import Bench, Segment
from sim_backend.errors import ConfigError

LOOPBACK = "127.0.0.1"

Say = Callable[[str], None]


class ServeOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How an emulated bench is served.

    `bench` is the simulated bench behind it, with its `disturbance` at a level. A pty gets the lasting name `link`.
    `baud` throttles the line, `speed` paces the bench (1: real time; none: as fast as it computes). `lifeline`: end
    when standard input does. A `host` that other machines reach needs `allow_remote` and a token, from `token_file` or
    the environment.
    """

    bench: str = "sim"
    seed: int = 0
    disturbance: float = 1.0
    transport: Literal["pty", "tcp"] = "pty"
    host: str = LOOPBACK
    port: int = 0
    link: str | None = None
    baud: float | None = None
    speed: float | None = None
    faults: str | None = None
    lifeline: bool = False
    allow_remote: bool = False
    token_file: str | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.port < 65536:
            raise ConfigError(f"emulated bench: port {self.port}; it must lie in 0 to 65535, 0 takes a free one")
        for name in ("baud", "speed"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise ConfigError(f"emulated bench: {name} is {value}; it must be a finite number above zero")


def serve(options: ServeOptions, open_bench: Callable[[str, int, float], Bench], say: Say, journal: Say) -> None:
    """Serve until SIGINT, SIGTERM, SIGHUP or the end of the lifeline; leave the bench safe.

    `say` gets the address under which clients find it, `journal` one line per state that the bench enters. Raises
    ConfigError for options that cannot be, HardwareError for a port that cannot be had.
    """
    faults = None if options.faults is None else parse_faults(options.faults)
    token = None
    if options.transport == "tcp":
        token = shared_token(None if options.token_file is None else Path(options.token_file))
    port = _port(options, token)  # before the bench, which takes its time: most mistakes are made here
    try:
        _serve_at(port, options, token, faults, open_bench, say, journal)
    finally:
        port.close()


def _serve_at(
    port: Port,
    options: ServeOptions,
    token: bytes | None,
    faults: tuple[int, FaultSpec] | None,
    open_bench: Callable[[str, int, float], Bench],
    say: Say,
    journal: Say,
) -> None:
    _warm(open_bench(options.bench, options.seed, options.disturbance))
    bench = open_bench(options.bench, options.seed, options.disturbance)
    boots = (secrets.randbelow(2**31) for _ in itertools.count())
    started_s = time.monotonic()

    def note(state: str, why: str) -> None:
        journal(f"{time.monotonic() - started_s:10.3f} s  {state:8s} {why}")

    firmware = Firmware(bench, boots, speed=options.speed, journal=note)
    server = Server(
        firmware, port, baud=options.baud, faults=faults, token=token, remark=lambda why: note("refused", why)
    )
    before = {number: signal.signal(number, server.stop) for number in _ENDING}
    try:
        if options.allow_remote:
            note("remote", f"whoever shows the token may drive this bench over {server.address}; nothing is encrypted")
        say(server.address)
        server.run(sys.stdin.fileno() if options.lifeline else None)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    struck = ", ".join(f"{kind} {count}" for kind, count in server.faults_struck.items() if count)
    note("ended", f"safe{f'; faults: {struck}' if struck else ''}")


def _warm(bench: Bench) -> None:
    """Let the first run ever compile before a client waits for it; on a bench apart, for playing draws noise."""
    still = np.zeros((1, len(bench.axes)))
    bench.play(Segment("warm", 1, still, still))
    bench.close()


_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def _port(options: ServeOptions, token: bytes | None) -> Port:
    if options.transport == "pty":
        return PtyPort(None if options.link is None else Path(options.link))
    address = resolved(options.host, options.port)[0]
    if not is_loopback(address):
        if not options.allow_remote:
            raise ConfigError(
                f"--host {options.host}: other machines could drive this bench; give --allow-remote and a token, or "
                f"stay on {LOOPBACK} and let them in by ssh -L"
            )
        if token is None:
            raise ConfigError(
                f"--allow-remote: there is no token; write one into a file for --token-file, or set {TOKEN}, here and "
                "where the hosts are"
            )
    return TcpPort(address)
