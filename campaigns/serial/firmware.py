"""The bench's side of the protocol: a state machine around any Bench. It does no input or output and holds no clock.

docs/serial-protocol.md is its specification; firmware for a real bench does the same with its own drives.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from zlib import crc32

from campaigns.serial.answers import (
    MAX_BURST_BLOCKS,
    Incoming,
    Refused,
    Reply,
    Upload,
    burst,
    integers,
    number,
    vetted,
)
from campaigns.serial.commands import (
    NO_CHALLENGE,
    PROTOCOL,
    UNCHECKED,
    UNLOCKED,
    Code,
    Command,
    Failure,
    State,
    Status,
    format_error,
    format_status,
    parse_command,
)
from campaigns.serial.description import Description, describe, encode_description
from campaigns.serial.frames import Block, Line
from campaigns.serial.play import Play, Recording
from sim_backend.bench import Bench, Segment

ERROR_QUEUE = 16
MAX_RUN = 2**31 - 1
WATCHDOG_S = (0.2, 60.0)

Journal = Callable[[str, str], None]
"""Called with the state that is entered and why."""


class Firmware:
    """State machine of one bench. `handle` answers lines, `store` takes uploaded blocks, `tick` lets time pass.

    `speed` paces simulated time (1: real time, None: as fast as it computes); `boots` yields a number per start.
    """

    def __init__(
        self,
        bench: Bench,
        boots: Iterator[int],
        *,
        speed: float | None = None,
        travel_factor: float = 2.0,
        current_factor: float = 1.05,
        memory_bytes: int = 512_000_000,
        journal: Journal = lambda _state, _why: None,
    ) -> None:
        # twice the end stops: the end-stop test leans on them (up to 1.6 times on the bench as built), a lost
        # interferometer or a broken stop goes further
        self._about = describe(
            bench, travel_factor=travel_factor, current_factor=current_factor, memory_bytes=memory_bytes
        )
        self._document = encode_description(self._about)
        self._bench = bench
        self._boots = boots
        self._speed = speed
        self._journal = journal
        self._play: Play | None = None
        self._start()

    def _start(self) -> None:
        self._boot = next(self._boots)
        self._epoch = 0
        self._state = State.IDLE
        self._safe = True
        self._fault = Failure(Code.NONE, "")
        self._errors: deque[Failure] = deque()
        self._owner: str | None = None
        self._watchdog_s = 5.0
        self._heard_s = 0.0
        self._run = 0
        self._incoming: Incoming | None = None
        self._armed: Segment | None = None
        self._recording: Recording | None = None
        self._journal(self._state.value, "started")

    @property
    def safe(self) -> bool:
        """Whether all drives are zero and all loops open."""
        return self._safe

    @property
    def owner(self) -> str | None:
        """The name that holds the lock."""
        return self._owner

    @property
    def description(self) -> Description:
        """What the bench says of itself."""
        return self._about

    @property
    def busy(self) -> bool:
        """Whether it has work that goes on without the line."""
        return self._play is not None

    def restart(self) -> None:
        """Do what a reset of the controller does: drives to zero, everything forgotten."""
        self._make_safe(State.IDLE, "reset")
        self._start()

    def shut_down(self) -> None:
        """Leave the bench safe and let it go."""
        self._make_safe(State.IDLE, "shut down")
        self._settle(wait=True)
        self._bench.close()

    def hear(self, now_s: float) -> None:
        """Note that the host lives."""
        self._heard_s = now_s

    def tick(self, now_s: float) -> None:
        """Let time pass: the end of a run, the interlocks, the watchdog."""
        self._settle(wait=False)
        if self._play is not None and not self._play.condemned:
            outcome = self._play.outcome(now_s)
            if isinstance(outcome, Recording):
                self._recording, self._play = outcome, None
                self._enter(State.DONE, f"run {self._run}")
            elif outcome is not None:
                self._trip(outcome.code, outcome.message)
        if (not self._safe or self._state is State.ARMED) and now_s - self._heard_s > self._watchdog_s:
            self._trip(Code.WATCHDOG, f"watchdog: the host was silent for more than {self._watchdog_s:g} s")

    def handle(self, line: Line, holder: str | None, now_s: float) -> Reply | Upload | None:
        """Carry out one line; `holder` is the name under which this line's sender has locked the bench, if it has."""
        self.tick(now_s)
        try:
            command = parse_command(line.text)
            if command is None:
                raise Refused(Code.UNKNOWN, f"undefined header: {line.text[:40]}")
            if line.tag is None and command.header not in UNCHECKED:
                raise Refused(Code.PROTECTED, f"{command.header} needs a tag and a checksum")
            owns = holder is not None and holder == self._owner
            if owns and line.tag is not None:
                self.hear(now_s)
            if not owns and command.header not in UNLOCKED:
                raise Refused(Code.LOCKED, f"{command.header} needs the lock; send SYSTem:LOCK first")
            return self._dispatch(command, now_s)
        except Refused as refused:
            if len(self._errors) == ERROR_QUEUE:
                self._errors[-1] = Failure(Code.OVERFLOW, "queue overflow")
            else:
                self._errors.append(refused.failure)
            return Reply(f"ERR {format_error(refused.failure.code, refused.failure.message)}")

    def store(self, block: Block, expected: int) -> bool:
        """Take an uploaded block; return whether it is the one that was `expected`."""
        incoming = self._incoming
        if incoming is None or block.run != incoming.run or block.sequence != expected:
            return False
        if expected == incoming.next:
            incoming.data += block.data
        return True

    def next_block(self) -> int:
        """Return the first block of the upload that is still missing."""
        return 0 if self._incoming is None else self._incoming.next

    def _dispatch(self, command: Command, now_s: float) -> Reply | Upload | None:
        p = command.parameters
        match command.header:
            case "*IDN?":
                who = self._bench.identity
                return Reply(",".join(v.replace(",", " ") for v in (who.kind, who.name, who.serial, who.version)))
            case "*CLS":
                self._errors.clear()
                return Reply("OK")
            case "SYSTEM:VERSION?":
                return Reply(PROTOCOL)
            case "SYSTEM:ERROR?":
                found = self._errors.popleft() if self._errors else Failure(Code.NONE, "No error")
                return Reply(format_error(found.code, found.message))
            case "SYSTEM:DESCRIBE?":
                return self._describe(p)
            case "SYSTEM:BEAT":
                return None
            case "SYSTEM:CHALLENGE?":  # this bench has no token; one that has stands behind a Guard
                return Reply(NO_CHALLENGE)
            case "SYSTEM:AUTHENTICATE":
                return Reply("OK")
            case "STATUS?":
                return Reply(format_status(self._status(now_s)))
            case "ABORT":
                self._make_safe(State.IDLE, "abort")
                return Reply(f"OK {self._boot},{self._epoch}")
            case _:
                return self._change(command, now_s)

    def _change(self, command: Command, now_s: float) -> Reply | Upload | None:
        p = command.parameters
        match command.header:
            case "SYSTEM:LOCK":
                return self._lock(p, now_s)
            case "SYSTEM:UNLOCK":
                self._make_safe(State.IDLE, "unlock")
                self._owner = None
                return Reply("OK")
            case "SYSTEM:WATCHDOG":
                self._watchdog_s = number(p, *WATCHDOG_S)
                return Reply(f"OK {self._watchdog_s:g}")
            case "SEGMENT:BEGIN":
                return self._begin(*integers(p, 3))
            case "SEGMENT:DATA":
                return self._announced(*integers(p, 3))
            case "ARM":
                return self._arm(*integers(p, 3))
            case "INITIATE":
                return self._initiate(integers(p, 1)[0], now_s)
            case "RECORD?":
                kept = self._kept(*integers(p, 1))
                return Reply(f"{kept.rows},{kept.columns},{len(kept.image)},{kept.crc}")
            case _:
                return self._data(*integers(p, 3))

    def _describe(self, p: tuple[str, ...]) -> Reply:
        if not p:
            return Reply(f"{len(self._document)},{crc32(self._document)}")
        first, count = integers(p, 2)
        return burst(self._document, 0, first, count)

    def _lock(self, p: tuple[str, ...], now_s: float) -> Reply:
        if len(p) != 1 or not (1 <= len(p[0]) <= 32 and p[0].isalnum()):
            raise Refused(Code.PARAMETER, "SYSTem:LOCK takes a name of 1 to 32 letters and digits")
        if self._owner not in (None, p[0]) and now_s - self._heard_s <= self._watchdog_s:
            raise Refused(Code.LOCKED, "another host holds the bench; wait until it has let go")
        self._owner = p[0]
        self.hear(now_s)
        return Reply(f"OK {self._boot},{self._epoch}")

    def _begin(self, run: int, total_bytes: int, crc: int) -> Reply:
        self._require_no_fault()
        if self._incoming is not None and (run, total_bytes, crc) == (
            self._incoming.run,
            self._incoming.total_bytes,
            self._incoming.crc,
        ):
            return Reply(f"OK {self._incoming.next}")
        if self._state is State.RUNNING:
            raise Refused(Code.CONFLICT, f"run {self._run} is being played; wait for it or abort")
        if not self._run < run <= MAX_RUN:
            raise Refused(Code.RANGE, f"run {run}; the next is {self._run + 1} or later")
        if not 0 < total_bytes <= self._about.memory_bytes:
            raise Refused(Code.TOO_MUCH, f"a segment of {total_bytes} bytes; the memory is {self._about.memory_bytes}")
        self._incoming = Incoming(run, total_bytes, crc, bytearray())
        self._run, self._armed, self._recording = run, None, None
        if self._state is not State.IDLE:
            self._enter(State.IDLE if self._safe else State.DONE, f"upload of run {run}")
        return Reply("OK 0")

    def _announced(self, run: int, first: int, count: int) -> Upload:
        incoming = self._incoming
        if incoming is None or run != incoming.run:
            raise Refused(Code.STALE, f"run {run} is not being uploaded; send SEGMent:BEGin first")
        if not (0 <= first <= incoming.next and 0 < count <= MAX_BURST_BLOCKS):
            raise Refused(Code.RANGE, f"{count} blocks from {first}; send block {incoming.next} next")
        return Upload(run, first, count, incoming.total_bytes)

    def _arm(self, run: int, boot: int, epoch: int) -> Reply:
        self._require_no_fault()
        if (boot, epoch) != (self._boot, self._epoch):
            raise Refused(
                Code.STALE,
                f"the bench was made safe or restarted since (boot {self._boot}, epoch {self._epoch}); begin anew",
            )
        if self._state is State.ARMED and run == self._run:
            return Reply("OK")
        incoming = self._incoming
        if incoming is None or run != incoming.run or len(incoming.data) != incoming.total_bytes:
            raise Refused(Code.CONFLICT, f"run {run} is not uploaded whole; send what is missing")
        if self._state is State.RUNNING or self._recording is not None:
            raise Refused(Code.CONFLICT, f"run {run} has been started; upload the next one")
        if crc32(incoming.data) != incoming.crc:
            raise Refused(Code.STALE, f"run {run} fails its checksum {incoming.crc}; upload it again as another run")
        self._armed = vetted(bytes(incoming.data), self._about)
        self._enter(State.ARMED, f"run {run}")
        return Reply("OK")

    def _initiate(self, run: int, now_s: float) -> Reply:
        self._require_no_fault()
        if run == self._run and (self._state is State.RUNNING or self._recording is not None):
            return Reply("OK")
        if self._state is not State.ARMED or run != self._run or self._armed is None:
            raise Refused(Code.CONFLICT, f"run {run} is not armed (state {self._state.value}); arm it first")
        self._safe = False
        # a play that is still in self._play is cancelled but computing: an ABORt must not wait for it
        self._play = Play(self._bench, self._about, self._armed, run, now_s, self._speed, self._play)
        self._enter(State.RUNNING, f"run {run}")
        return Reply("OK")

    def _kept(self, run: int) -> Recording:
        if self._recording is None or self._recording.run != run:
            self._require_no_fault()
            raise Refused(Code.STALE, f"there is no record of run {run} (state {self._state.value}); play it")
        return self._recording

    def _data(self, run: int, first: int, count: int) -> Reply:
        return burst(self._kept(run).image, run, first, count)

    def _status(self, now_s: float) -> Status:
        played = 0 if self._recording is None else self._recording.rows
        if self._play is not None and not self._play.condemned:
            played = self._play.played(now_s)
        return Status(self._state, self._boot, self._epoch, self._run, played, False, len(self._errors))

    def _require_no_fault(self) -> None:
        if self._state is State.FAULT:
            raise Refused(Code.TRIPPED, f"{self._fault.message}; ABORt acknowledges it")

    def _trip(self, code: Code, message: str) -> None:
        self._fault = Failure(code, message)
        self._make_safe(State.FAULT, message)
        if len(self._errors) < ERROR_QUEUE:
            self._errors.append(self._fault)

    def _make_safe(self, state: State, why: str) -> None:
        """Zero the drives, open the loops. A simulated bench that is computing ahead is made safe when it ends."""
        if not self._safe:
            self._safe = True
            self._epoch += 1
            if self._play is None:
                self._bench.safe()
            else:
                self._play.condemn()
        self._armed = None
        if state is not self._state:
            self._enter(state, why)

    def _settle(self, *, wait: bool) -> None:
        """Once a condemned play has ended, make the simulated bench safe as the emulated one already is."""
        if self._play is not None and self._play.condemned and (wait or not self._play.working):
            self._play.join()
            self._bench.safe()
            self._play = None

    def _enter(self, state: State, why: str) -> None:
        self._state = state
        self._journal(state.value, why)
