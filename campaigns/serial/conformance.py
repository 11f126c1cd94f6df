"""Is a bench's firmware what the protocol says? Every rule that can be tried without moving anything, one by one.

All segments that are played are zero throughout: the loops stay open and the drives at zero.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from campaigns.serial.commands import Code, State, parse_error
from campaigns.serial.examiner import Broken, Examiner
from campaigns.serial.frames import BLOCK_BYTES, Block, blocks_in, encode_block, encode_line, split
from campaigns.serial.program import encode_segment
from campaigns.serial.transport import LinkLost, Transport
from sim_backend.errors import MccdError

_WEB_PAGE = b"POST / HTTP/1.1\r\nHost: bench\r\nContent-Type: text/plain\r\n\r\nABORt\r\n*IDN?\r\n"
"""What a browser sends for any web page that asks it to, commands included."""

CHECK_S = 60.0
"""How long one check may take."""

_IDLE_LINES = 12
_ABORT_S = 1.0
_NO_CONNECTIONS = "does not apply: a serial line has no connections"


@dataclass(frozen=True)
class CheckResult:
    """One rule of the protocol and whether the bench keeps it."""

    name: str
    ok: bool
    detail: str


def _identity(x: Examiner) -> str:
    who = x.identity
    return f"{who.name} {who.serial}, version {who.version}"


def _description(x: Examiner) -> str:
    about = x.about
    return f"{len(about.axes)} axes, {len(about.channels)} channels, {about.rate_hz:g} Hz, {about.memory_bytes} bytes"


def _error_queue(x: Examiner) -> str:
    x.link.request("*CLS")
    x.refused("NO:SUCH:HEADER", Code.UNKNOWN)
    first, second = (parse_error(x.link.request("SYST:ERR?")) for _ in range(2))
    x.expect(first is not None and first.code == Code.UNKNOWN, f"the queue gives {first}, not {int(Code.UNKNOWN)}")
    x.expect(second is not None and second.code == 0, f"the queue then gives {second}, not 0")
    return "an error is queued once"


def _long_form(x: Examiner) -> str:
    answer = x.link.request("system:version?")
    x.expect(answer == x.link.request("SYST:VERS?"), f"long and short form differ: {answer[:40]}")
    return answer


def _unchecked(x: Examiner) -> str:
    x.link.request("*CLS")
    x.link.send(encode_line("SYST:WATC 7"))
    found = parse_error(x.link.request("SYST:ERR?"))
    x.expect(found is not None and found.code == Code.PROTECTED, f"an unchecked command leaves {found} in the queue")
    return "commands without checksum are refused"


def _damaged_line(x: Examiner) -> str:
    before = x.status()
    x.link.send(encode_line("SYST:WATC 7", 1).replace(b"7", b"8", 1))
    x.link.send(b"\xff\x00" * 400)
    x.expect(x.status() == before, "a damaged line changes the status")
    return "damaged lines are passed over"


def _lock(x: Examiner) -> str:
    answer = x.link.exchange("SYST:LOCK somebodyelse") or "not at all"
    found = parse_error(answer.removeprefix("ERR "))
    x.expect(found is not None and found.code == Code.LOCKED, f"another host's lock is answered '{answer[:40]}'")
    return "another host is refused"


def _upload(x: Examiner) -> str:
    image = encode_segment(x.quiet(10), x.about.channel_names) + bytes(3 * BLOCK_BYTES)
    blocks, last = split(image, x.run + 1), blocks_in(len(image))
    x.begin(image)
    bad = bytearray(encode_block(blocks[1]))
    bad[-9] ^= 0x10
    payload = encode_block(blocks[0]) + bytes(bad) + b"".join(map(encode_block, blocks[2:]))
    answer = x.link.exchange(f"SEGM:DATA {x.run},0,{last}", payload)
    x.expect(answer == "OK 1", f"a damaged block 1 is answered '{answer}', not 'OK 1'")
    payload = b"".join(map(encode_block, blocks[1:]))
    answer = x.link.exchange(f"SEGM:DATA {x.run},1,{last - 1}", payload)
    x.expect(answer == f"OK {last}", f"the rest is answered '{answer}', not 'OK {last}'")
    answer = x.link.request(x.begun)
    x.expect(answer == f"OK {last}", f"SEGMent:BEGin once more is answered '{answer}', not 'OK {last}'")
    return f"{last} blocks, one of them damaged and sent again"


def _broken_upload(x: Examiner) -> str:
    image = bytes(2 * BLOCK_BYTES)
    x.begin(image)
    half = encode_block(Block(x.run, 0, image[:BLOCK_BYTES]))[: BLOCK_BYTES // 2]
    started_s = time.monotonic()
    answer = x.link.exchange(f"SEGM:DATA {x.run},0,2", half)
    took_s = time.monotonic() - started_s
    x.expect(answer == "OK 0", f"an upload that falls silent is answered '{answer}', not 'OK 0'")
    return f"given up after {took_s:.2f} s"


def _nonsense(x: Examiner) -> str:
    image = bytes(100)
    x.begin(image)
    x.link.upload(x.begun, "SEGM:DATA", x.run, image)
    return x.refused(f"ARM {x.run},{x.link.boot},{x.link.epoch}", Code.RANGE)


def _limits(x: Examiner) -> str:
    found = [(i, limit) for i, limit in enumerate(x.about.reference) if limit is not None]
    if not found:
        return "the bench states no limits"
    axis, limit = found[0]
    beyond = np.zeros((1, len(x.about.axes)))
    beyond[0, axis] = 1.01 * limit
    x.upload(replace(x.quiet(10), reference=beyond))
    return f"{x.about.axes[axis]}: {x.refused(f'ARM {x.run},{x.link.boot},{x.link.epoch}', Code.RANGE)}"


def _stale_arm(x: Examiner) -> str:
    x.upload(x.quiet(10))
    return x.refused(f"ARM {x.run},{x.link.boot},{x.link.epoch + 1}", Code.STALE)


def _unarmed_start(x: Examiner) -> str:
    x.upload(x.quiet(10))
    return x.refused(f"INIT {x.run}", Code.CONFLICT)


def _states(x: Examiner) -> str:
    segment = x.quiet(100)
    x.upload(segment)
    x.in_state(State.IDLE, 0.0)
    x.arm()
    x.arm()
    x.in_state(State.ARMED, 0.0)
    x.link.request(f"INIT {x.run}")
    x.in_state(State.DONE)
    image = x.record(100)
    x.link.request(f"INIT {x.run}")
    x.expect(x.record(100) == image, "starting a run a second time changes its record")
    return f"idle, armed, running, done; {len(image)} bytes; repeated commands do nothing"


def _download(x: Examiner) -> str:
    x.start(x.quiet(2000))
    x.in_state(State.DONE)
    image = x.record(2000)
    x.expect(image == x.record(2000), "a record downloaded twice differs")
    last = blocks_in(len(image)) - 1
    x.expect(x.link.request(f"REC:DATA? {x.run},{last},5") == f"{last},1", "the last block is not announced as 1 block")
    x.refused(f"REC:DATA? {x.run},{last + 1},1", Code.RANGE)
    x.refused(f"REC? {x.run + 1}", Code.STALE)
    return f"{last + 1} blocks, the same twice"


def _reconnection(x: Examiner) -> str:
    x.start(x.quiet(2000))
    x.in_state(State.DONE)
    before = x.record(2000)
    x.link.close()
    x.link.open()
    x.expect(x.record(2000) == before, "the record differs after the line was closed and opened")
    return "the record outlasts the line"


def _abort(x: Examiner) -> str:
    for what in ("armed", "running", "done"):
        x.upload(x.quiet(100 if what == "done" else int(5 * x.about.rate_hz)))
        x.arm()
        if what != "armed":
            x.link.request(f"INIT {x.run}")
        if what == "done":
            x.in_state(State.DONE)
        epoch = x.status()[2]
        x.link.make_safe()
        state, _, after, _ = x.status()
        x.expect(state is State.IDLE, f"an abort while {what} leaves the state {state.value}, not idle")
        x.expect(after == epoch + (what != "armed"), f"an abort while {what} takes the epoch from {epoch} to {after}")
    return "idle from armed, running and done"


def _watchdog(x: Examiner) -> str:
    x.link.request("SYST:WATC 0.5")
    x.start(x.quiet(100))
    x.in_state(State.DONE)
    x.link.request("*CLS")
    epoch = x.status()[2]
    time.sleep(1.0)
    state, _, after, _ = x.status()
    x.expect(state is State.FAULT and after == epoch + 1, f"silent for 1 s, the state is {state.value}, epoch {after}")
    found = parse_error(x.link.request("SYST:ERR?"))
    x.expect(found is not None and found.code == Code.WATCHDOG, f"the error queue holds {found}")
    x.refused(f"SEGM:BEG {x.run + 1},100,0", Code.TRIPPED)
    x.link.make_safe()
    x.in_state(State.IDLE, 0.0)
    x.link.request("SYST:WATC 5")
    return "safe after 0.5 s of silence, acknowledged by ABORt"


def _stranger(x: Examiner) -> str:
    x.link.request("SYST:WATC 0.5")
    x.start(x.quiet(100))
    x.in_state(State.DONE)
    epoch, end_s = x.status()[2], time.monotonic() + 1.0
    while time.monotonic() < end_s:
        x.link.exchange("SYST:LOCK somebodyelse")
        time.sleep(0.1)
    state, _, after, _ = x.status()
    x.link.exchange("SYST:UNL")  # whoever has the lock by now
    x.link.make_safe()
    x.link.request("SYST:WATC 5")
    what = f"while another host asked for the lock for 1 s, the state stayed {state.value}, epoch {after}"
    x.expect(state is State.FAULT and after == epoch + 1, what)
    return "another host's requests do not keep the drives held"


def _greeting(x: Examiner) -> str:
    if x.network is None:
        return _NO_CONNECTIONS
    x.start(x.quiet(100))
    x.in_state(State.DONE)
    with contextlib.closing(x.network.another()) as stranger:
        stranger.open(_ABORT_S)
        stranger.write(_WEB_PAGE, _ABORT_S)
        said, end_s = b"", time.monotonic() + _ABORT_S
        with contextlib.suppress(LinkLost):
            while time.monotonic() < end_s and len(said) < 1000:
                said += stranger.read(_ABORT_S)
            raise Broken(f"a connection that begins as a web page's does is not hung up within {_ABORT_S:g} s")
    x.expect(not said, f"a web page is answered {said[:40]!r}")
    x.in_state(State.DONE, 0.0)
    return "a web page is hung up, nothing of it is carried out"


def _abort_among_idle(x: Examiner) -> str:
    if x.network is None:
        return _NO_CONNECTIONS
    with contextlib.ExitStack() as stack:
        lines = [stack.enter_context(contextlib.closing(x.network.another())) for _ in range(_IDLE_LINES + 1)]
        for i, line in enumerate(lines[:-1]):
            line.open(_ABORT_S)
            line.write(encode_line("*IDN?") if i % 2 else b"*ID", _ABORT_S)
        x.start(x.quiet(100))
        x.in_state(State.DONE)
        lines[-1].open(_ABORT_S)
        started_s = time.monotonic()
        lines[-1].write(encode_line("ABOR"), _ABORT_S)
        said = lines[-1].read(_ABORT_S)
        took_s = time.monotonic() - started_s
    x.expect(
        b"OK " in said, f"beside {_IDLE_LINES} idle connections, ABORt is answered {said[:40]!r} in {took_s:.2f} s"
    )
    x.link.make_safe()
    return f"{_ABORT_S:g} s are enough beside {_IDLE_LINES} idle connections"


CHECKS: dict[str, Callable[[Examiner], str]] = {
    "identity": _identity,
    "description": _description,
    "error queue": _error_queue,
    "long and short form": _long_form,
    "commands need a checksum": _unchecked,
    "damaged lines": _damaged_line,
    "lock": _lock,
    "upload with a damaged block": _upload,
    "upload that falls silent": _broken_upload,
    "image that is none": _nonsense,
    "limits are kept": _limits,
    "arming after a safe state": _stale_arm,
    "start without arming": _unarmed_start,
    "states and repetition": _states,
    "download": _download,
    "line closed and opened": _reconnection,
    "abort at any time": _abort,
    "greeting": _greeting,
    "abort beside idle connections": _abort_among_idle,
    "watchdog": _watchdog,
    "watchdog and other clients": _stranger,
}
"""The only list of checks; each returns what it saw or raises."""


def check_bench(
    transport: Transport, report: Callable[[float, float, str], None] = lambda *_: None
) -> list[CheckResult]:
    """Put the bench at `transport` to every check; raises HardwareError when it cannot be reached at all."""
    examiner = Examiner(transport)
    results = []
    try:
        for done, (name, check) in enumerate(CHECKS.items()):
            report(done, len(CHECKS), name)
            results.append(_result(name, check, examiner))
    finally:
        examiner.close()
    return results


def _result(name: str, check: Callable[[Examiner], str], examiner: Examiner) -> CheckResult:
    try:
        examiner.link.limit(CHECK_S)
        examiner.link.make_safe()
        return CheckResult(name, True, check(examiner))
    except (Broken, MccdError) as error:
        return CheckResult(name, False, str(error))
    except ValueError as error:
        return CheckResult(name, False, f"an answer cannot be read: {error}")
