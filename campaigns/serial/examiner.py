"""A bench under test: what the checks of its firmware need, in a few words each."""

from __future__ import annotations

import time
from zlib import crc32

import numpy as np

from campaigns.serial.client import SerialBench
from campaigns.serial.commands import Code, State, parse_status
from campaigns.serial.link import BenchRefusal, Link
from campaigns.serial.program import encode_segment
from campaigns.serial.transport import TcpTransport, Transport
from sim_backend.bench import Segment
from sim_backend.errors import ConfigError

_WAIT_S = 5.0


class Broken(Exception):  # noqa: N818 - it is a finding about the bench, not a failure of this program
    """A rule that the bench does not keep."""


class Examiner:
    """A bench under test: what the checks need, in a few words each."""

    def __init__(self, transport: Transport) -> None:
        bench = SerialBench(transport, "checked")
        self.about, self.identity = bench.description, bench.identity
        bench.close()
        self.network = transport if isinstance(transport, TcpTransport) else None
        self.link = Link(transport)
        self.link.open()
        self.link.make_safe()
        self.run = self.status()[3]
        self.begun = ""

    def close(self) -> None:
        """Leave the bench safe and let it go."""
        self.link.limit(_WAIT_S)
        try:
            self.link.make_safe()
            self.link.request("SYST:UNL")
        finally:
            self.link.close()

    def status(self) -> tuple[State, int, int, int]:
        """Return state, boot, epoch and run."""
        text = self.link.request("STAT?")
        found = parse_status(text)
        if found is None:
            raise Broken(f"the status is '{text[:60]}'")
        return found.state, found.boot, found.epoch, found.run

    def refused(self, text: str, *codes: Code) -> str:
        """Make sure that a command is refused with one of `codes`."""
        try:
            answer = self.link.request(text)
        except BenchRefusal as refusal:
            code = refusal.failure.code
        except ConfigError as error:
            code = next((c for c in codes if f"error {int(c)})" in str(error)), Code.NONE)
        else:
            raise Broken(f"'{text}' is answered '{answer[:40]}', not refused")
        if code not in codes:
            raise Broken(f"'{text}' is refused with {code}, not {' or '.join(str(int(c)) for c in codes)}")
        return f"refused with {int(code)}"

    def expect(self, holds: bool, otherwise: str) -> None:
        """Break off unless something holds."""
        if not holds:
            raise Broken(otherwise)

    def in_state(self, state: State, within_s: float = _WAIT_S) -> None:
        """Wait until the bench is in a state."""
        end_s = time.monotonic() + within_s
        while (now := self.status()[0]) is not state:
            if time.monotonic() > end_s:
                raise Broken(f"the state is {now.value}, not {state.value} within {within_s:g} s")
            time.sleep(0.005)

    def quiet(self, n_samples: int) -> Segment:
        """Return a segment in which nothing moves, recording everything."""
        zero = np.zeros((1, len(self.about.axes)))
        return Segment("conformance", n_samples, zero, zero, record=self.about.channel_names)

    def upload(self, segment: Segment) -> bytes:
        """Upload a segment as the next run."""
        image = encode_segment(segment, self.about.channel_names)
        self.begin(image)
        self.link.upload(self.begun, "SEGM:DATA", self.run, image)
        return image

    def begin(self, image: bytes) -> str:
        """Announce an image as the next run."""
        self.run += 1
        self.begun = f"SEGM:BEG {self.run},{len(image)},{crc32(image)}"
        return self.link.request(self.begun)

    def arm(self) -> str:
        """Arm the run."""
        return self.link.request(f"ARM {self.run},{self.link.boot},{self.link.epoch}")

    def start(self, segment: Segment) -> None:
        """Upload, arm and start a segment."""
        self.upload(segment)
        self.arm()
        self.link.request(f"INIT {self.run}")

    def record(self, n_samples: int) -> bytes:
        """Return the record of the run, a quiet segment of so many samples."""
        _, _, size, crc = (int(w) for w in self.link.request(f"REC? {self.run}").split(","))
        wanted = 8 * n_samples * len(self.about.channels)
        self.expect(size == wanted, f"the record has {size} bytes, not {wanted}")
        return self.link.download("REC:DATA?", self.run, size, crc)
