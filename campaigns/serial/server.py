"""The emulated bench as a process: the loop between a port and the firmware, with a throttle and seeded faults.

Whoever connects is heard at once, so that an ABORt always gets through: connections are bounded by hanging up on those
that say nothing, never by turning away a newcomer.
"""

from __future__ import annotations

import selectors
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from campaigns.serial.faults import Event, FaultSpec, FaultyLine
from campaigns.serial.firmware import Firmware
from campaigns.serial.guard import Guard, NoGreeting
from campaigns.serial.ports import Channel, Port
from campaigns.serial.session import Session

BITS_PER_BYTE = 10
"""On a serial line: start bit, eight data bits, stop bit."""

CREDIT_S = 0.1
"""What a throttle lets catch up: on a busy machine a process waits so long for its turn, and a line does not."""

MAX_HOSTS = 8
"""Connections that were admitted. For one more, that which has been silent longest is hung up, never the lock's."""

MAX_WAITING = 32
"""Connections that have not greeted or not shown the token; for one more, the oldest is hung up."""

GREET_S = 5.0
"""How long a connection may take for greeting and token in all, whatever drips in."""

IDLE_S = 60.0
"""Without a command or a good block for so long, a connection that does not hold the lock is hung up."""

REMARKS = 20
"""Remarks that may come at once, and one more a second: unknown hosts must not fill a disk."""

_PIECE_BYTES = 65536
_TURN_BYTES = 16384
"""What one connection may bring in before the next one's turn: so long an ABORt waits for a host that floods."""

_ACCEPTED_AT_ONCE = 8
_BUSY_S, _PATIENCE_S = 0.001, 0.05
_GONE_S = 0.2
"""A dropped terminal stays away for so long, as an adapter that is pulled and put back."""

_AWAY_S = 0.25
"""What counts at most of a time in which this process had no turn, five times as long as it ever waits by itself."""


class Clock:
    """Seconds that the server has lived through.

    A controller on a bench never waits for its turn; a process on a busy machine may, for seconds. What a host has
    sent meanwhile lies unread, so that counting them would trip the watchdog on a host that was not silent.
    """

    def __init__(self) -> None:
        self._seen_s = time.monotonic()
        self._lived_s = 0.0

    def now_s(self) -> float:
        """Return the time; between two questions it grows by _AWAY_S at most."""
        seen_s = time.monotonic()
        self._lived_s += min(seen_s - self._seen_s, _AWAY_S)
        self._seen_s = seen_s
        return self._lived_s


class Throttle:
    """How many bytes a line of `baud` lets pass by now; None means no limit."""

    def __init__(self, baud: float | None, now_s: float) -> None:
        self._rate = None if baud is None else baud / BITS_PER_BYTE
        self._credit = 0.0
        self._last_s = now_s

    def allowance(self, now_s: float) -> int:
        """Return how many bytes may pass now; what a line did not use within CREDIT_S is lost."""
        if self._rate is None:
            return _PIECE_BYTES
        self._credit = min(self._credit + (now_s - self._last_s) * self._rate, max(self._rate * CREDIT_S, 16.0))
        self._last_s = now_s
        return int(self._credit)

    def spend(self, count: int) -> None:
        """Note that so many bytes have passed."""
        self._credit -= count


class _Way:
    """One direction of a connection: what is under way, and until when it is held."""

    def __init__(self, faults: FaultyLine | None, throttle: Throttle) -> None:
        self.faults = faults
        self.throttle = throttle
        self.pieces: deque[bytes | Event] = deque()
        self.held_until_s = 0.0

    def put(self, data: bytes) -> None:
        self.pieces.extend([data] if self.faults is None else self.faults.pass_on(data))


class Connection:
    """A line to one host, between its channel and its session."""

    def __init__(
        self, channel: Channel, firmware: Firmware, to_bench: _Way, to_host: _Way, guard: Guard | None, now_s: float
    ) -> None:
        self.channel = channel
        self.opened_s = now_s
        self._firmware = firmware
        self._guard = guard
        self._session = Session(firmware, guard)
        self._to_bench = to_bench
        self._to_host = to_host

    @property
    def admitted(self) -> bool:
        """Whether its host may say everything; a terminal has no connection, so there it always may."""
        return self._guard is None or self._guard.admits

    @property
    def active_s(self) -> float:
        """When its host last said something that is a command or a block."""
        return max(self.opened_s, self._session.active_s)

    @property
    def holds_the_lock(self) -> bool:
        """Whether its host has locked the bench."""
        return self._session.holds_the_lock

    def overdue(self, now_s: float) -> str:
        """Return why to hang up on it by now, were it not the holder's; empty when there is no reason."""
        if self._guard is None:
            return ""
        if not self.admitted:
            late = now_s - self.opened_s > GREET_S
            return f"it has not greeted, or not shown the token, within {GREET_S:g} s" if late else ""
        return f"it has been silent for {IDLE_S:g} s" if now_s - self.active_s > IDLE_S else ""

    def patience_s(self, now_s: float) -> float:
        """How long nothing but new bytes can make it necessary to act."""
        waiting = [way.held_until_s - now_s for way in (self._to_bench, self._to_host) if way.pieces]
        return min([_PATIENCE_S, *(max(wait_s, _BUSY_S) for wait_s in waiting)])

    def pump(self, now_s: float) -> float:
        """Move bytes both ways; return for how long the firmware stalls.

        Raises EOFError or OSError when the line is gone, NoGreeting when it does not begin as a host's does.
        """
        if allowed := min(self._to_bench.throttle.allowance(now_s), _TURN_BYTES):
            if data := self.channel.read(allowed):
                self._to_bench.throttle.spend(len(data))
                self._to_bench.put(data)
        stall_s = self._deliver(now_s)
        self._session.tick(now_s)
        return max(stall_s, self._send(now_s))

    def close(self) -> None:
        """Hang up."""
        self.channel.close()

    def _deliver(self, now_s: float) -> float:
        way = self._to_bench
        while way.pieces and now_s >= way.held_until_s:
            piece = way.pieces.popleft()
            if isinstance(piece, bytes):
                if seen := piece if self._guard is None else self._guard.greet(piece):
                    self._session.feed(seen, now_s)
            elif stall_s := self._happen(piece, way, now_s):
                return stall_s
        return 0.0

    def _send(self, now_s: float) -> float:
        way = self._to_host
        while now_s >= way.held_until_s:
            if not way.pieces:
                data = self._session.next_bytes()
                if not data:
                    break
                way.put(data)
            piece = way.pieces.popleft()
            if not isinstance(piece, bytes):
                if stall_s := self._happen(piece, way, now_s):
                    return stall_s
                continue
            sent = self.channel.write(piece[: way.throttle.allowance(now_s)]) if piece else 0
            way.throttle.spend(sent)
            if sent < len(piece):
                way.pieces.appendleft(piece[sent:])
                break
        return 0.0

    def _happen(self, event: Event, way: _Way, now_s: float) -> float:
        """Let a fault happen; return for how long the firmware stalls."""
        if event.kind == "drop":
            raise EOFError
        if event.kind == "reset":
            self._firmware.restart()
            self._session = Session(self._firmware, self._guard)
        elif event.kind == "delay":
            way.held_until_s = now_s + event.duration_s
        return event.duration_s if event.kind == "stall" else 0.0


class Server:
    """Serves one firmware at one port until `stop` or the end of the lifeline; everything happens in `run`'s thread.

    With a `token`, connections of a network port have to show it. `remark` receives whom it refuses or hangs up on, and
    why; REMARKS bounds how often.
    """

    def __init__(
        self,
        firmware: Firmware,
        port: Port,
        *,
        baud: float | None = None,
        faults: tuple[int, FaultSpec] | None = None,
        token: bytes | None = None,
        remark: Callable[[str], None] = lambda _why: None,
    ) -> None:
        self._firmware = firmware
        self._port = port
        self._baud = baud
        self._ways = [
            None if faults is None else FaultyLine(faults[1], np.random.default_rng([faults[0], 2 + i]))
            for i in range(2)
        ]
        self._connections: list[Connection] = []
        self._selector = selectors.DefaultSelector()
        self._clock = Clock()
        self._stalled_until_s = 0.0
        self._return_s = 0.0
        self._token = token
        self._remark = remark
        self._remarks = float(REMARKS)
        self._remarked_s = self._clock.now_s()
        self._unsaid = 0
        self._stopping = False

    @property
    def address(self) -> str:
        """How clients name it."""
        return self._port.address

    def stop(self, *_signal: object) -> None:
        """End `run` soon; may be called from a signal handler."""
        self._stopping = True

    @property
    def faults_struck(self) -> dict[str, int]:
        """How often each kind of fault has struck."""
        total: dict[str, int] = {}
        for way in self._ways:
            for kind, count in ({} if way is None else way.struck).items():
                total[kind] = total.get(kind, 0) + count
        return total

    def run(self, lifeline: int | None = None) -> None:
        """Serve until `stop`, or until the other end of the file number `lifeline` is closed; leave the bench safe."""
        if (number := self._port.fileno()) is not None:
            self._selector.register(number, selectors.EVENT_READ)
        if lifeline is not None:
            self._selector.register(lifeline, selectors.EVENT_READ, "lifeline")
        try:
            while not self._stopping:
                self._turn()
        finally:
            self._firmware.shut_down()
            for connection in self._connections:
                connection.close()
            self._port.close()
            self._selector.close()

    def _turn(self) -> None:
        for key, _ in self._selector.select(self._patience_s()):
            if key.data == "lifeline":
                self._stopping = True
        now_s = self._clock.now_s()
        self._firmware.tick(now_s)
        if now_s < self._stalled_until_s:
            return
        self._accept(now_s)
        for connection in list(self._connections):
            try:
                stall_s = connection.pump(now_s)
            except NoGreeting as error:
                self._dismiss(connection, f"{error}; nothing of it was carried out", now_s)
                continue
            except (EOFError, OSError):
                self._hang_up(connection, now_s)
                continue
            if stall_s:
                self._stalled_until_s = now_s + stall_s
                return
        self._make_room(now_s)

    def _accept(self, now_s: float) -> None:
        if now_s < self._return_s and not self._port.is_network:
            return
        for _ in range(_ACCEPTED_AT_ONCE):
            if (channel := self._port.accept()) is None:
                return
            self._open(channel, now_s)

    def _make_room(self, now_s: float) -> None:
        """Hang up on whoever is overdue, and on the most silent of those beyond the limit."""
        holder = self._holder()
        for connection in list(self._connections):
            if connection is not holder and (why := connection.overdue(now_s)):
                self._dismiss(connection, why, now_s)
        waiting = [c for c in self._connections if not c.admitted]
        for connection in waiting[: max(len(waiting) - MAX_WAITING, 0)]:  # in the order in which they came
            self._dismiss(connection, f"{MAX_WAITING} others wait to greet, it the longest", now_s)
        hosts = [c for c in self._connections if c.admitted]
        silent = sorted((c for c in hosts if c is not holder), key=lambda c: c.active_s)
        for connection in silent[: max(len(hosts) - MAX_HOSTS, 0)]:
            self._dismiss(connection, f"{MAX_HOSTS} others are connected, it was silent the longest", now_s)

    def _holder(self) -> Connection | None:
        """Return the one connection that is kept because its host has locked the bench.

        Many may have locked it by one name, as after a line that broke: it is the one that spoke last.
        """
        holders = [c for c in self._connections if c.holds_the_lock]
        return max(holders, key=lambda c: c.active_s, default=None)

    def _patience_s(self) -> float:
        """How long to wait for bytes: hardly, while something else than they can make it necessary to act."""
        now_s = self._clock.now_s()
        if now_s < self._stalled_until_s:
            time.sleep(min(self._stalled_until_s - now_s, _PATIENCE_S))  # the line may be readable all the while
        elif self._baud is not None:
            time.sleep(_BUSY_S)
        if self._firmware.busy:
            return _BUSY_S
        return min([_PATIENCE_S, *(connection.patience_s(now_s) for connection in self._connections)])

    def _open(self, channel: Channel, now_s: float) -> None:
        to_bench, to_host = (_Way(faults, Throttle(self._baud, now_s)) for faults in self._ways)
        guard = Guard(self._token, self._told_of(channel)) if self._port.is_network else None
        self._connections.append(Connection(channel, self._firmware, to_bench, to_host, guard, now_s))
        self._selector.register(channel.fileno(), selectors.EVENT_READ)

    def _hang_up(self, connection: Connection, now_s: float) -> None:
        self._selector.unregister(connection.channel.fileno())
        connection.close()
        self._connections.remove(connection)
        self._return_s = now_s + _GONE_S

    def _dismiss(self, connection: Connection, why: str, now_s: float) -> None:
        self._tell(f"{connection.channel.peer}: {why}; hung up", now_s)
        self._hang_up(connection, now_s)

    def _told_of(self, channel: Channel) -> Callable[[str], None]:
        return lambda why: self._tell(f"{channel.peer}: {why}", self._clock.now_s())

    def _tell(self, what: str, now_s: float) -> None:
        """Make a remark, or count it where there were too many."""
        self._remarks = min(self._remarks + now_s - self._remarked_s, float(REMARKS))
        self._remarked_s = now_s
        if self._remarks < 1.0:
            self._unsaid += 1
            return
        self._remark(what + (f" (after {self._unsaid} more that are not shown)" if self._unsaid else ""))
        self._remarks, self._unsaid = self._remarks - 1.0, 0
