"""Questions and answers over a line that may damage, lose or repeat anything, or vanish and come back.

Every request carries a tag of its own and is answered under it, every command may be sent twice without harm, so the
one remedy for whatever goes wrong is to ask again, a bounded number of times.
"""

from __future__ import annotations

import re
import secrets
import time
from zlib import crc32

from campaigns.serial.commands import NO_CHALLENGE, Code, Failure, parse_error
from campaigns.serial.frames import (
    MAX_TAG,
    Block,
    LineNoise,
    Receiver,
    block_length,
    blocks_in,
    data_bytes_of,
    encode_block,
    encode_line,
    split,
)
from campaigns.serial.guard import answer_to
from campaigns.serial.transport import LinkLost, Transport
from sim_backend.errors import ConfigError, HardwareError

TRIES = 6
STRIKES = 20
"""How often one block may fail: each costs hardly more than its own time on the line."""

REPLY_S = 1.0
"""How long an answer may take beyond the time of its bytes; longer than the bench waits for a broken upload."""

QUIET_S = 0.3
"""A pause in the middle of a download after which bytes have been lost."""

OPEN_S = 5.0
"""How long a lost line may stay away."""

BEAT_S = 0.5
_BURST_S = 1.0
_BURST_BLOCKS = (4, 1024)
_IN_BUFFERS = 8192
"""Bytes that may still lie in the buffers of the line ahead of an answer."""

_MOST_BYTES = 1 << 24
"""How much may come in before an answer: the end of a burst is a million bytes, a network holds some more."""

_BLOCK_S = 0.25
"""How long a block may take beyond three times its bytes, however it drips in."""

_CHALLENGE = re.compile("[0-9a-f]{32}")

_REFUSALS_OF_WHAT_WAS_ASKED = {Code.RANGE, Code.TOO_MUCH}


class BenchRefusal(HardwareError):  # noqa: N818 - it names what happened
    """The bench said no, and why."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(f"the bench refuses: {failure.message} (error {failure.code})")
        self.failure = failure


class Link:
    """Requests and transfers over one transport, under one lock.

    After `open`, `boot` and `epoch` are the bench's; a reconnection that finds others raises HardwareError, for then
    the bench has not gone on where it was. `deadline` bounds whatever is being done.
    """

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._receiver = Receiver()
        self._name = secrets.token_hex(8)
        self._tag = secrets.randbelow(MAX_TAG)
        self._open = False
        self._beaten_s = 0.0
        self._deadline_s = float("inf")
        self.boot = -1
        self.epoch = -1
        self.retries = 0

    @property
    def name(self) -> str:
        """The transport's."""
        return self._transport.name

    @property
    def bytes_per_s(self) -> float:
        """The transport's."""
        return self._transport.bytes_per_s

    @property
    def burst_blocks(self) -> int:
        """Blocks sent in one go: about a second of the line, so that its delays do not count."""
        low, high = _BURST_BLOCKS
        return int(min(max(self.bytes_per_s * _BURST_S / block_length(data_bytes_of(0, 1 << 20)), low), high))

    def limit(self, seconds: float) -> None:
        """Let everything from now on end within `seconds`."""
        self._deadline_s = time.monotonic() + seconds

    def open(self) -> None:
        """Connect and lock the bench; raises HardwareError when it stays away or belongs to another host."""
        last: HardwareError = LinkLost(f"{self.name} cannot be reached; check the line")
        give_up_s = min(time.monotonic() + OPEN_S, self._deadline_s)
        while True:
            try:
                self._transport.open(REPLY_S)
                self._receiver.clear()
                self._open = True
                self._begin()
                return
            except LineNoise as error:
                last = error
                self._drop()
            if time.monotonic() > give_up_s:
                raise HardwareError(str(last)) from None
            time.sleep(0.1)

    def close(self) -> None:
        """Let the line go."""
        self._drop()

    def send(self, raw: bytes) -> None:
        """Send bytes as they are; raises LinkLost."""
        self._transport.write(raw, REPLY_S)

    def request(self, text: str, payload: bytes = b"", tries: int = TRIES) -> str:
        """Return the answer to `text`; `payload` are the blocks it announces.

        Raises BenchRefusal (or ConfigError, for what no bench like this can be asked) when the bench says no,
        HardwareError when it does not answer.
        """
        for attempt in range(tries):
            answer = self._attempt(text, payload)
            if answer is not None:
                return answer
            if attempt == tries // 2:  # perhaps the line, not the bench, has got stuck
                self._drop()
        raise HardwareError(
            f"{self.name}: no answer to '{text.partition(' ')[0]}' in {tries} tries of {REPLY_S:g} s or more; "
            "check bench and line"
        )

    def make_safe(self) -> None:
        """Abort, and take the bench as it is from then on; raises HardwareError when it does not answer."""
        self.boot = self.epoch = -1
        self.boot, self.epoch = _pair(self.request("ABOR"))

    def upload(self, begin: str, command: str, run: int, image: bytes) -> None:
        """Announce `image` by `begin`, which answers with the first block that is missing, and send it by `command`.

        Raises HardwareError when it does not arrive.
        """
        blocks, burst, strikes = split(image, run), self.burst_blocks, 0
        at = _whole_number(self.request(begin), "OK ")
        while at < len(blocks):
            sent = blocks[at : at + burst]
            answer = self._attempt(f"{command} {run},{at},{len(sent)}", b"".join(map(encode_block, sent)))
            arrived = _whole_number(self.request(begin) if answer is None else answer, "OK ")
            strikes = 0 if arrived > at else strikes + 1
            burst = min(2 * burst, self.burst_blocks) if arrived == at + len(sent) else max(burst // 2, 1)
            self._check_strikes(strikes, "upload")
            at = arrived

    def download(self, command: str, run: int, total_bytes: int, crc: int) -> bytes:
        """Return what the bench sends by `command`; what is damaged or lost on the way is asked for again."""
        parts: list[bytes] = []
        burst, strikes, count = self.burst_blocks, 0, blocks_in(total_bytes)
        prefix = f"{run}," if run else ""
        while len(parts) < count:
            at = len(parts)
            answer = self.request(f"{command} {prefix}{at},{min(burst, count - at)}")
            coming = _whole_number(answer, f"{at},")
            try:
                for i in range(at, min(at + coming, count)):
                    wait_s = REPLY_S if i == at else QUIET_S
                    parts.append(self._block(run, i, data_bytes_of(i, total_bytes), wait_s).data)
            except LinkLost:
                self._drop()
            except LineNoise:
                self.retries += 1
            strikes = 0 if len(parts) > at else strikes + 1
            burst = min(2 * burst, self.burst_blocks) if len(parts) == at + coming else max(burst // 2, 1)
            self._check_strikes(strikes, "download")
        image = b"".join(parts)
        if crc32(image) != crc:
            raise HardwareError(
                f"{self.name}: what was downloaded fails its checksum {crc:08X} though every block passed; "
                "repeat the segment"
            )
        return image

    def gone_on(self, boot: int, epoch: int) -> HardwareError:
        """Return the error for a bench that is no longer where this host left it, and take it as it is now."""
        what = "restarted" if boot != self.boot else "went to its safe state"
        was, self.boot, self.epoch = (self.boot, self.epoch), boot, epoch
        return HardwareError(
            f"{self.name}: the bench {what} (boot, epoch {was} before, {(boot, epoch)} now) and has forgotten the run; "
            "begin it anew"
        )

    def beat(self) -> None:
        """Tell the bench that the host lives, now and then; it does not answer. Raises LinkLost."""
        now_s = time.monotonic()
        if now_s - self._beaten_s > BEAT_S:
            self._beaten_s = now_s
            self._transport.write(encode_line("SYST:BEAT", self._next_tag()), REPLY_S)

    def _begin(self) -> None:
        """Greet the bench, show the token if there is one, and lock it, all within the time of TRIES answers."""
        end_s = time.monotonic() + TRIES * self._answer_s(0)
        self._answered("*IDN?", end_s)
        if self._transport.token is not None:
            self._show(self._transport.token, end_s)
        self._lock(end_s)

    def _show(self, token: bytes, end_s: float) -> None:
        """Prove that this host knows the token; a bench that needs none is not asked."""
        challenge = self._answered("SYST:CHAL?", end_s)
        if challenge == NO_CHALLENGE or challenge.startswith(f"ERR {int(Code.UNKNOWN)},"):
            return
        if not _CHALLENGE.fullmatch(challenge):
            raise HardwareError(
                f"{self.name} answers '{challenge[:60]}' where a challenge belongs; update its firmware"
            )
        _accepted(self._answered(f"SYST:AUTH {answer_to(token, challenge)}", end_s))

    def _lock(self, end_s: float) -> None:
        """Lock the bench, and make sure that it is where this host left it."""
        boot, epoch = _pair(_accepted(self._answered(f"SYST:LOCK {self._name}", end_s)))
        if self.boot >= 0 and (boot, epoch) != (self.boot, self.epoch):
            raise self.gone_on(boot, epoch)
        self.boot, self.epoch = boot, epoch

    def _answered(self, text: str, end_s: float) -> str:
        """Ask until there is an answer; raises LinkLost when there is none by `end_s`."""
        while time.monotonic() < end_s:
            if (answer := self.exchange(text)) is not None:
                return answer
            self._check_time(text)
        raise LinkLost(f"{self.name}: the bench does not answer; check that it is on and speaks this protocol")

    def _attempt(self, text: str, payload: bytes = b"") -> str | None:
        """Ask once, over a new connection or under a new lock where the old one is lost; None without an answer."""
        self._check_time(text)
        if not self._open:
            self.open()
        try:
            # no sign of life behind a payload: where bytes of it were lost, it would be taken for them
            answer = self.exchange(text, payload, beats=not payload)
            if answer is None:
                self.retries += 1
            return None if answer is None else _accepted(answer)
        except LinkLost:
            self._drop()
        except BenchRefusal as refusal:
            if refusal.failure.code != Code.LOCKED:
                raise
            self._lock(time.monotonic() + TRIES * self._answer_s(0))
        return None

    def exchange(self, text: str, payload: bytes = b"", *, beats: bool = False) -> str | None:
        """Send a request once and return the answer with its tag, None when none comes in time.

        With `beats` signs of life go out meanwhile, for the request may have been lost.
        """
        tag = self._next_tag()
        answer_s = self._answer_s(len(payload))
        end_s, heard = time.monotonic() + answer_s, 0
        self._transport.write(encode_line(text, tag) + payload, answer_s)
        self._beaten_s = time.monotonic()
        left_s = answer_s
        while left_s > 0.0:
            # the last look waits for nothing: what came in while this process waited for its turn is still taken
            left_s = max(end_s - time.monotonic(), 0.0)
            if beats:
                self.beat()
            data = self._transport.read(min(left_s, BEAT_S) if beats else left_s)
            self._receiver.feed(data)
            heard += len(data)
            if heard > _MOST_BYTES:
                raise LinkLost(f"{self.name} sends without end and does not answer; check that it is a bench")
            while (line := self._receiver.line()) is not None:
                if line.tag == tag:
                    return line.text
        return None

    def _answer_s(self, payload_bytes: int) -> float:
        """How long one answer may take, whatever comes in meanwhile."""
        return REPLY_S + (payload_bytes + _IN_BUFFERS) / self.bytes_per_s

    def _block(self, run: int, sequence: int, data_bytes: int, wait_s: float) -> Block:
        """Return the next block off the line; raises LineNoise when it is another, damaged or late."""
        end_s = time.monotonic() + wait_s + 3.0 * block_length(data_bytes) / self.bytes_per_s + _BLOCK_S
        while (block := self._receiver.block(data_bytes)) is None:
            self._check_time("a block")
            self.beat()
            # when time is up what has come in is still taken, for this process may have had to wait for its turn
            data = self._transport.read(min(wait_s, max(end_s - time.monotonic(), 0.0)))
            if not data:
                raise LineNoise(f"{self.name}: block {sequence} did not come; it is asked for again")
            self._receiver.feed(data)
        if (block.run, block.sequence) != (run, sequence):
            raise LineNoise(f"{self.name}: block {block.sequence} came in place of {sequence}; it is asked for again")
        return block

    def _next_tag(self) -> int:
        self._tag = (self._tag + 1) % (MAX_TAG + 1)
        return self._tag

    def _drop(self) -> None:
        self._open = False
        self._transport.close()
        self._receiver.clear()

    def _check_time(self, what: str) -> None:
        if time.monotonic() > self._deadline_s:
            raise HardwareError(f"{self.name}: time is up while waiting for '{what.partition(' ')[0]}'; check the line")

    def _check_strikes(self, strikes: int, what: str) -> None:
        self._check_time(what)
        if strikes >= STRIKES:
            raise HardwareError(f"{self.name}: {what} made no progress in {STRIKES} tries; check the line for noise")


def _accepted(answer: str) -> str:
    """Return the answer unless it is a refusal: ConfigError for what was asked, BenchRefusal for all else."""
    if not answer.startswith("ERR "):
        return answer
    failure = parse_error(answer[4:]) or Failure(Code.HARDWARE, answer)
    if failure.code in _REFUSALS_OF_WHAT_WAS_ASKED:
        raise ConfigError(f"{failure.message} (the bench's error {failure.code})")
    raise BenchRefusal(failure)


def _whole_number(answer: str, prefix: str) -> int:
    word = answer.removeprefix(prefix)
    if not word.isdecimal():
        raise HardwareError(f"the bench answers '{answer[:60]}' where a number belongs; update its firmware")
    return int(word)


def _pair(answer: str) -> tuple[int, int]:
    words = answer.removeprefix("OK ").split(",")
    if len(words) != 2 or not all(w.isdecimal() for w in words):
        raise HardwareError(f"the bench answers '{answer[:60]}' where boot and epoch belong; update its firmware")
    return int(words[0]), int(words[1])
