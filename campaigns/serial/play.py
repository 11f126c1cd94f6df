"""One segment being played beside the line: the emulated firmware goes on listening while the bench works."""

from __future__ import annotations

import dataclasses
import threading
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from campaigns.serial.commands import Code
from campaigns.serial.description import Description
from campaigns.serial.program import encode_record, record_channels
from sim_backend.bench import Array, Bench, Segment
from sim_backend.errors import MccdError


@dataclass(frozen=True)
class Trip:
    """An interlock: which, after how many samples, and what to say."""

    code: Code
    sample: int
    message: str


@dataclass(frozen=True)
class Recording:
    """The record of one run as it goes over the line; `crc` covers all of it."""

    run: int
    rows: int
    columns: int
    image: bytes
    crc: int


class Play:
    """A segment on its way through the bench, in a thread of its own.

    A simulated bench computes a segment at once; with a `speed` (1: real time) its time passes all the same, so that
    the outside sees `played` grow and can abort. An interlock trips at the sample where the bench would have.
    It begins once the condemned play `after` which it comes has ended and the bench has been made safe, so that nobody
    has to wait for that.
    """

    def __init__(
        self,
        bench: Bench,
        description: Description,
        segment: Segment,
        run: int,
        started_s: float,
        speed: float | None,
        after: Play | None = None,
    ) -> None:
        self.run = run
        self._bench = bench
        self._description = description
        self._segment = segment
        self._started_s = started_s
        self._speed = speed
        self._after = after
        self._condemned = False
        self._recording: Recording | None = None
        self._trip: Trip | None = None
        self._thread = threading.Thread(target=self._work, name=f"run {run}", daemon=True)
        self._thread.start()

    def condemn(self) -> None:
        """Let nobody have its outcome; if the bench has not begun it, it never does."""
        self._condemned = True

    @property
    def condemned(self) -> bool:
        """Whether it was aborted while the bench went on computing."""
        return self._condemned

    def join(self) -> None:
        """Wait until the bench is free again."""
        self._thread.join()

    @property
    def working(self) -> bool:
        """Whether the bench is still computing."""
        return self._thread.is_alive()

    def played(self, now_s: float) -> int:
        """Return how many samples have passed."""
        n = self._segment.n_samples
        if self._speed is None:
            return 0 if self.working else n
        return min(n, int((now_s - self._started_s) * self._description.rate_hz * self._speed))

    def outcome(self, now_s: float) -> Recording | Trip | None:
        """Return what the segment came to, None while it goes on."""
        if self.working:
            return None
        last = self._segment.n_samples if self._trip is None else self._trip.sample
        if self.played(now_s) < last:
            return None
        return self._trip or self._recording

    def _work(self) -> None:
        if self._after is not None:
            self._after.join()
            self._bench.safe()
            self._after = None
        if self._condemned:
            return
        try:
            self._recording = self._record()
        except MccdError as error:
            self._trip = Trip(Code.HARDWARE, 0, str(error))
        except Exception as error:  # whatever a bench does, the firmware says so and stays alive
            self._trip = Trip(Code.HARDWARE, 0, f"the bench failed: {type(error).__name__}: {error}")

    def _record(self) -> Recording | None:
        about, segment = self._description, self._segment
        wanted = record_channels(segment, about.channel_names, about.default_names)
        # The interlocks watch these whatever is recorded. A bench that loses samples of a reading draws the losses
        # when the reading is taken, so a segment that leaves a reading out is the one case that is not bit for bit.
        watched = tuple(c.name for c in about.channels if c.role in ("input", "output") or c.unit == "A")
        asked = tuple(name for name in about.channel_names if name in {*wanted, *watched})
        channels = self._bench.play(dataclasses.replace(segment, record=asked)).channels
        self._trip = tripped(about, channels)
        if self._trip is not None:
            return None
        image = encode_record([channels[name] for name in wanted])
        return Recording(self.run, segment.n_samples, len(wanted), image, crc32(image))


def tripped(about: Description, channels: dict[str, Array]) -> Trip | None:
    """Return the interlock that a record trips first: a reading beyond the travel, a coil current beyond the limit.

    A bench without current channels is judged by its commands. Channels (n_samples,) each.
    """
    found: list[Trip] = []
    outputs = [c for c in about.channels if c.role == "output"]
    for channel, limit in zip(outputs, about.travel, strict=False):
        found += _beyond(channels[channel.name], limit, Code.OVER_TRAVEL, "over-travel", channel.name, channel.unit)
    for name, current in _currents(about, channels).items():
        found += _beyond(current, about.trip_current_a, Code.OVER_CURRENT, "over-current", name, "A")
    return min(found, key=lambda trip: trip.sample, default=None)


def _currents(about: Description, channels: dict[str, Array]) -> dict[str, Array]:
    measured = {c.name: channels[c.name] for c in about.channels if c.unit == "A" and c.role == "aux"}
    if measured:
        return measured
    commands = [channels[c.name] for c in about.channels if c.role == "input"]
    return {f"actuator {i + 1}": np.array(row) @ np.array(commands) for i, row in enumerate(about.to_current)}


def _beyond(values: Array, limit: float | None, code: Code, what: str, name: str, unit: str) -> list[Trip]:
    if limit is None:
        return []
    over = ~(np.abs(values) <= limit)  # so that a reading that is no number trips as well
    if not over.any():
        return []
    first = int(np.argmax(over))
    message = f"{what}: {name} reached {values[first]:.4g} {unit} at sample {first}, the limit is {limit:.4g} {unit}"
    return [Trip(code, first, message)]
