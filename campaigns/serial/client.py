"""A bench at the other end of a line, behind the same Bench protocol as the simulated one."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from zlib import crc32

from campaigns.serial.commands import PROTOCOL, Code, State, Status, parse_status
from campaigns.serial.description import Description, decode_description
from campaigns.serial.frames import blocks_in
from campaigns.serial.link import BenchRefusal, Link
from campaigns.serial.program import decode_record, encode_segment, record_channels
from campaigns.serial.transport import Transport
from sim_backend.bench import Identity, Limits, Record, Segment, Signal, check_segment
from sim_backend.errors import ConfigError, HardwareError, MccdError

WATCHDOG_S = 5.0
"""Silence after which the bench makes itself safe. Between two segments the host may be silent for so long."""

SETTLE_S = 6 * 3600.0
"""How long a bench may take to settle at another temperature."""

_CALL_S = 15.0
"""What everything that is not a transfer may take together, retries included."""

_BLOCK_S = 0.25
"""What a block of a transfer may take beyond its time on the line: a bad line is slow, not out of order."""

_POLL_S = (0.002, 0.1)


class SerialBench:
    """A bench over a Transport: uploads a segment, arms, starts, watches, downloads the record.

    Opening it locks the bench, acknowledges an old fault and sets the watchdog to `watchdog_s`. Raises HardwareError
    when the bench does not answer, is another host's or speaks another protocol.
    """

    def __init__(self, transport: Transport, kind: str, *, watchdog_s: float = WATCHDOG_S) -> None:
        self._link = Link(transport)
        self._kind = kind
        self.left_safe = False
        try:
            self._link.limit(_CALL_S)
            self._link.open()
            self._link.make_safe()
            self._link.request("*CLS")
            spoken = self._link.request("SYST:VERS?")
            if spoken != PROTOCOL:
                raise HardwareError(f"{self._link.name} speaks {spoken[:40]}, this mccd {PROTOCOL}; update one of them")
            self._link.request(f"SYST:WATC {watchdog_s:g}")
            self._identity = self._who()
            self._about = self._describe()
            self._run = self.status().run
        except BaseException:
            self._link.close()
            raise

    @property
    def identity(self) -> Identity:
        """How it is reached, and who it says it is."""
        return self._identity

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Every channel that it can record."""
        return self._about.signals

    @property
    def axes(self) -> tuple[str, ...]:
        """The degrees of freedom, in the order of all waveforms."""
        return self._about.axes

    @property
    def limits(self) -> Limits:
        """What it may be asked."""
        return self._about.limits

    @property
    def description(self) -> Description:
        """Everything fixed about it."""
        return self._about

    @property
    def retries(self) -> int:
        """How often something had to be asked for again."""
        return self._link.retries

    def status(self) -> Status:
        """Ask what it is doing; raises HardwareError when it does not say."""
        text = self._link.request("STAT?")
        status = parse_status(text)
        if status is None:
            raise HardwareError(f"{self._link.name} gives the status '{text[:60]}'; update its firmware")
        return status

    def play(self, segment: Segment) -> Record:
        """Play one segment from the present state and return the record.

        Raises ConfigError for a segment beyond the limits or the memory of the bench, HardwareError when bench or line
        fails; it never returns the record of another run.
        """
        names = self._names(segment)
        check_segment(segment, self.limits)
        image = encode_segment(segment, self._about.channel_names)
        record_bytes = 8 * segment.n_samples * len(names)
        if max(record_bytes, len(image)) > self._about.memory_bytes:
            raise ConfigError(
                f"segment '{segment.label}': {record_bytes} bytes to record, {len(image)} to play, the bench has room "
                f"for {self._about.memory_bytes}; cut the segment or record fewer channels"
            )
        try:
            run = self._start(image)
            self._watch(segment, run)
            return self._fetch(segment, run, names)
        except HardwareError as error:
            raise HardwareError(f"segment '{segment.label}': {self._explained(error)}") from None

    def safe(self) -> None:
        """Zero all drives and open all loops; never raises. If the message is lost, the watchdog does it."""
        self.left_safe = False
        with contextlib.suppress(MccdError):
            self._link.limit(_CALL_S)
            self._link.make_safe()
            self.left_safe = True

    def close(self) -> None:
        """Leave the bench safe, unlock it and let the line go."""
        self.safe()
        if self.left_safe:
            with contextlib.suppress(MccdError):
                self._link.request("SYST:UNL")
        self._link.close()

    def _explained(self, error: HardwareError) -> HardwareError:
        """Return the reason behind a refusal: a bench that restarted knows nothing of what it is asked."""
        if isinstance(error, BenchRefusal) and error.failure.code in (Code.STALE, Code.CONFLICT):
            with contextlib.suppress(MccdError):
                status = self.status()
                if (status.boot, status.epoch) != (self._link.boot, self._link.epoch):
                    return self._link.gone_on(status.boot, status.epoch)
        return error

    def _start(self, image: bytes) -> int:
        """Upload, arm and start; return the number of the run."""
        self._run += 1
        run = self._run
        self._limit_transfer(len(image))
        self._link.upload(f"SEGM:BEG {run},{len(image)},{crc32(image)}", "SEGM:DATA", run, image)
        self._link.request(f"ARM {run},{self._link.boot},{self._link.epoch}")
        self._link.request(f"INIT {run}")
        return run

    def _watch(self, segment: Segment, run: int) -> None:
        """Wait until the segment has been played; raises HardwareError when the bench has left it."""
        rate_hz = self._about.rate_hz
        settle_s = SETTLE_S if segment.cold_finger_k is not None else 0.0
        self._link.limit(_CALL_S + settle_s + 2.0 * segment.n_samples / rate_hz)
        pause_s, longest_s = _POLL_S
        while True:
            status = self.status()
            if status.state is State.DONE and status.run == run:
                return
            if status.state is State.FAULT:
                self._link.request(f"ARM {run},{status.boot},{status.epoch}")  # is refused with the fault's own message
            if (status.boot, status.epoch) != (self._link.boot, self._link.epoch):
                raise self._link.gone_on(status.boot, status.epoch)
            if status.state is not State.RUNNING:
                raise HardwareError(f"the bench left the run for its state {status.state.value}; begin the run anew")
            time.sleep(pause_s)
            pause_s = min(2.0 * pause_s, longest_s)

    def _fetch(self, segment: Segment, run: int, names: tuple[str, ...]) -> Record:
        answer = self._link.request(f"REC? {run}")
        words = answer.split(",")
        if len(words) != 4 or not all(w.isdecimal() for w in words):
            raise HardwareError(f"the bench announces its record as '{answer[:60]}'; update its firmware")
        rows, columns, total_bytes, crc = (int(w) for w in words)
        if (rows, columns, total_bytes) != (segment.n_samples, len(names), 8 * rows * columns):
            raise HardwareError(
                f"the record has {rows} samples of {columns} channels in {total_bytes} bytes, asked for were "
                f"{segment.n_samples} of {len(names)}; update the bench's firmware"
            )
        self._limit_transfer(total_bytes)
        image = self._link.download("REC:DATA?", run, total_bytes, crc)
        return Record(segment, dict(zip(names, decode_record(image, rows, columns), strict=True)))

    def _names(self, segment: Segment) -> tuple[str, ...]:
        return record_channels(segment, self._about.channel_names, self._about.default_names)

    def _limit_transfer(self, count: int) -> None:
        self._link.limit(_CALL_S + 3.0 * count / self._link.bytes_per_s + _BLOCK_S * blocks_in(count))

    def _who(self) -> Identity:
        answer = self._link.request("*IDN?")
        words = [word.strip() for word in answer.split(",")]
        if len(words) != 4:
            raise HardwareError(f"{self._link.name} calls itself '{answer[:60]}'; four names with commas are wanted")
        return dataclasses.replace(Identity(*words), kind=self._kind)

    def _describe(self) -> Description:
        answer = self._link.request("SYST:DESC?")
        size, _, crc = answer.partition(",")
        if not (size.isdecimal() and crc.isdecimal()) or not 0 < int(size) <= _MOST_DESCRIPTION:
            raise HardwareError(f"{self._link.name} announces its description as '{answer[:60]}'; update its firmware")
        return decode_description(self._link.download("SYST:DESC?", 0, int(size), int(crc)))


_MOST_DESCRIPTION = 1_000_000
