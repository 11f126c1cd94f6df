"""An emulated bench of one's own: a process that serves a pty, and the client to it; both end together."""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
import time
from types import TracebackType
from typing import IO, Self

import msgspec

from campaigns.serial.client import WATCHDOG_S, SerialBench
from campaigns.serial.serve import ServeOptions
from campaigns.serial.transport import Transport, transport_at
from sim_backend.errors import ConfigError, HardwareError

START_S = 120.0
"""The first start ever compiles the simulated bench's loop, for half a minute on a busy machine."""

STOP_S = 30.0
COMMAND = (sys.executable, "-P", "-m", "campaigns.serial")  # nothing from the folder it is started in
PTY_BAUD = 4_000_000
"""A pseudo-terminal takes any; this one only bounds how long a transfer may take."""


class EmulatorProcess:
    """A served bench in a process of its own, which ends when its parent does, however that ends.

    `address` is where it serves. Its journal (one line per state entered) goes to `journal`, a file, or nowhere.
    """

    def __init__(self, options: ServeOptions, journal: IO[bytes] | None = None) -> None:
        text = msgspec.json.encode(msgspec.structs.replace(options, lifeline=True)).decode()
        self.process = subprocess.Popen(
            [*COMMAND, text],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL if journal is None else journal,
            start_new_session=True,  # a Ctrl-C at the terminal is for the host alone
        )
        try:
            self.address = self._first_line()
        except BaseException:
            self.close()
            raise

    def transport(self) -> Transport:
        """Return a new transport to the emulated bench, not yet opened."""
        kind, _, rest = self.address.partition(":")
        return transport_at(kind, f"{rest}@{PTY_BAUD}" if kind == "serial" else rest)

    def close(self) -> None:
        """End it; it leaves its bench safe."""
        process = self.process
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.close()

    def _first_line(self) -> str:
        assert self.process.stdout is not None
        number, text, end_s = self.process.stdout.fileno(), b"", time.monotonic() + START_S
        while not text.endswith(b"\n"):
            left_s = end_s - time.monotonic()
            piece = os.read(number, 4096) if left_s > 0 and select.select([number], [], [], left_s)[0] else b""
            if not piece:
                raise HardwareError(f"the emulated bench did not start within {START_S:g} s; try 'mccd bench serve'")
            text += piece
        line = text.decode().strip()
        if line.startswith("error "):
            _, code, message = line.split(" ", 2)
            raise (ConfigError if code == str(ConfigError.exit_code) else HardwareError)(message)
        return line


class EmulatedBench(SerialBench):
    """The simulated bench behind firmware, protocol and a pseudo-terminal, in another process."""

    def __init__(self, options: ServeOptions, *, watchdog_s: float = WATCHDOG_S) -> None:
        self.emulator = EmulatorProcess(options)
        try:
            super().__init__(self.emulator.transport(), "emulator", watchdog_s=watchdog_s)
        except BaseException:
            self.emulator.close()
            raise

    def close(self) -> None:
        """Leave the bench safe and end its process."""
        try:
            super().close()
        finally:
            self.emulator.close()
