"""One conversation with the firmware: bytes in, bytes out, no input or output of its own."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

from campaigns.serial.answers import Reply, Upload
from campaigns.serial.commands import parse_command
from campaigns.serial.firmware import Firmware
from campaigns.serial.frames import (
    Line,
    LineNoise,
    Receiver,
    block_length,
    blocks_in,
    data_bytes_of,
    encode_line,
)
from campaigns.serial.guard import Guard

SILENCE_S = 0.5
"""An upload that pauses for so long has lost bytes: the bench answers with what it has. The host waits longer."""


class _Burst:
    """Announced blocks as they come in; after a damaged one the rest is passed over, for its frame is lost."""

    def __init__(self, upload: Upload, tag: int) -> None:
        self.tag = tag
        self.run = upload.run
        self._total_bytes = upload.total_bytes
        self.at = upload.first
        self._end = min(upload.first + upload.count, blocks_in(upload.total_bytes))
        self._skip: int | None = None

    def take(self, receiver: Receiver, firmware: Firmware) -> bool:
        """Move what has come in to the firmware; return whether the burst is over."""
        while self._skip is None and self.at < self._end:
            try:
                block = receiver.block(self._size(self.at))
            except LineNoise:
                block, damaged = None, True
            else:
                damaged = block is not None and not firmware.store(block, self.at)
            if damaged:
                self._skip = sum(block_length(self._size(i)) for i in range(self.at + 1, self._end))
            elif block is None:
                return False
            else:
                self.at += 1
        if self._skip:
            self._skip -= receiver.discard(self._skip)
        return not self._skip

    def _size(self, sequence: int) -> int:
        return data_bytes_of(sequence, self._total_bytes)


class Session:
    """What one host has sent and is still to get. A new question ends the answer to the one before."""

    def __init__(self, firmware: Firmware, guard: Guard | None = None) -> None:
        self._firmware = firmware
        self._guard = guard
        self._receiver = Receiver()
        self._holder: str | None = None
        self._burst: _Burst | None = None
        self._heard_s = 0.0
        self._active_s = 0.0
        self._lines: deque[bytes] = deque()
        self._stream: Iterator[bytes] = iter(())

    @property
    def active_s(self) -> float:
        """When a command or a good block last came; bytes that become neither do not count."""
        return self._active_s

    @property
    def holds_the_lock(self) -> bool:
        """Whether the host at this line has locked the bench."""
        return self._holder is not None and self._holder == self._firmware.owner

    def feed(self, data: bytes, now_s: float) -> None:
        """Take bytes from the host."""
        self._receiver.feed(data)
        self._heard_s = now_s
        self._advance(now_s)

    def tick(self, now_s: float) -> None:
        """Let time pass: an upload that has fallen silent is answered."""
        if self._burst is not None and now_s - self._heard_s > SILENCE_S:
            self._receiver.clear()
            self._end_burst(self._burst)

    def next_bytes(self) -> bytes:
        """Return the next bytes for the host, empty when there are none."""
        return self._lines.popleft() if self._lines else next(self._stream, b"")

    def _advance(self, now_s: float) -> None:
        while True:
            if self._burst is not None:
                self._firmware.hear(now_s)
                taken, over = self._burst.at, self._burst.take(self._receiver, self._firmware)
                if self._burst.at > taken:
                    self._active_s = now_s
                if not over:
                    return
                self._end_burst(self._burst)
            line = self._receiver.line()
            if line is None:
                return
            self._answer(line, now_s)

    def _answer(self, line: Line, now_s: float) -> None:
        if parse_command(line.text) is not None:
            self._active_s = now_s
        if self._guard is not None and (refusal := self._guard.refusal(line)) is not None:
            self._send(refusal, line.tag)
            return
        wanted = _lock_wanted(line)
        if wanted not in (None, self._holder):
            self._holder = None  # another host speaks here from now on: it must not keep the watchdog quiet
        reply = self._firmware.handle(line, self._holder, now_s)
        if isinstance(reply, Upload) and line.tag is not None:
            self._burst = _Burst(reply, line.tag)
        elif isinstance(reply, Reply):
            if wanted is not None and reply.text.startswith("OK"):
                self._holder = wanted
            self._send(reply, line.tag)

    def _end_burst(self, burst: _Burst) -> None:
        self._burst = None
        self._send(Reply(f"OK {self._firmware.next_block()}"), burst.tag)

    def _send(self, reply: Reply, tag: int | None) -> None:
        self._lines.clear()
        self._lines.append(encode_line(reply.text, tag))
        self._stream = reply.blocks


def _lock_wanted(line: Line) -> str | None:
    """Return the name under which a checked line asks for the lock, None for any other line."""
    command = parse_command(line.text)
    asks = command is not None and command.header == "SYSTEM:LOCK" and line.tag is not None
    return ",".join(command.parameters) if command is not None and asks else None
