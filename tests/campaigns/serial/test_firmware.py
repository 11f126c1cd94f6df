"""The state machine by itself, at times that the test chooses: interlocks, watchdog, error queue, lock."""

from __future__ import annotations

import itertools
import time
from typing import Any
from zlib import crc32

import numpy as np
import pytest

from campaigns.serial.answers import Reply
from campaigns.serial.commands import Status, parse_status
from campaigns.serial.firmware import ERROR_QUEUE, Firmware
from campaigns.serial.frames import Line, split
from campaigns.serial.play import tripped
from campaigns.serial.program import encode_segment
from sim_backend.bench import Segment
from sim_backend.simbench import SimBench
from tests.small_bench import NOISE, bench_model


class Host:
    """Talks to a firmware in whole lines, at a time that stands still unless told to pass."""

    def __init__(self, **options: Any) -> None:
        self.bench = SimBench(bench_model(NOISE), 1)
        self.journal: list[tuple[str, str]] = []
        self.firmware = Firmware(
            self.bench, itertools.count(100), journal=lambda state, why: self.journal.append((state, why)), **options
        )
        self.now_s = 0.0
        self.run = 0
        assert self.say("SYST:LOCK me", holder=None).startswith("OK 100,0")

    def say(self, text: str, *, holder: str | None = "me", tag: int | None = 1) -> str:
        reply = self.firmware.handle(Line(text, tag), holder, self.now_s)
        return reply.text if isinstance(reply, Reply) else str(reply)

    def status(self) -> Status:
        status = parse_status(self.say("STAT?", holder=None))
        assert status is not None
        return status

    def upload(self, segment: Segment) -> None:
        self.run += 1
        image = encode_segment(segment, tuple(s.name for s in self.bench.signals))
        assert self.say(f"SEGM:BEG {self.run},{len(image)},{crc32(image)}") == "OK 0"
        for block in split(image, self.run):
            assert self.firmware.store(block, block.sequence)

    def start(self, segment: Segment) -> None:
        self.upload(segment)
        status = self.status()
        assert self.say(f"ARM {self.run},{status.boot},{status.epoch}") == "OK"
        assert self.say(f"INIT {self.run}") == "OK"

    def until_computed(self) -> None:
        end_s = time.monotonic() + 20.0
        while self.firmware.busy and self.status().state.value == "running" and time.monotonic() < end_s:
            time.sleep(0.001)


def sine(amplitude_nm: float, n_samples: int = 10_000) -> Segment:
    """Return a torque on theta_x at its resonance, 29.6 Hz."""
    wave = np.zeros((n_samples, 3))
    wave[:, 0] = amplitude_nm * np.sin(2 * np.pi * 29.6 * np.arange(n_samples) / 1e4)
    return Segment("sine", n_samples, np.zeros((1, 3)).repeat(n_samples, 0), wave)


def test_over_travel_trips_at_the_sample_where_it_happens() -> None:
    host = Host(travel_factor=1.0)
    reading = SimBench(bench_model(NOISE), 1).play(sine(0.02)).channels["theta_x"]
    first = int(np.argmax(np.abs(reading) > 10e-3))
    assert first > 0  # at resonance a small torque goes beyond the end stops
    host.start(sine(0.02))
    host.until_computed()
    status = host.status()
    assert (status.state.value, status.epoch) == ("fault", 1)
    answer = host.say(f"REC? {host.run}")
    assert (
        answer.startswith('ERR 105,"over-travel: theta_x reached') and f"at sample {first}, the limit is 0.01" in answer
    )
    assert host.say("SYST:ERR?").startswith("101,")
    assert not np.any(host.bench._mem.closed) and not np.any(host.bench._mem.queue)  # noqa: SLF001 - the drives


def test_a_fault_holds_until_it_is_acknowledged() -> None:
    host = Host(current_factor=0.01)
    host.start(sine(0.05, 200))
    host.until_computed()
    assert host.say("SEGM:BEG 9,100,0").startswith("ERR 105")
    assert host.say("ABOR") == "OK 100,1"
    host.start(sine(1e-4, 100))
    host.until_computed()
    assert host.status().state.value == "done"


def test_over_current_trips() -> None:
    host = Host(current_factor=0.01)
    host.start(sine(0.05, 200))  # 0.21 A against 0.09 A
    host.until_computed()
    assert host.status().state.value == "fault"
    assert host.say("SYST:ERR?").startswith('102,"over-current: current_A1 reached')


def test_a_reading_that_is_no_number_trips() -> None:
    host = Host()
    about = host.firmware.description
    channels = {c.name: np.zeros(4) for c in about.channels}
    assert tripped(about, channels) is None
    channels["theta_y"] = np.array([0.0, 0.0, np.nan, 0.0])
    trip = tripped(about, channels)
    assert trip is not None and trip.sample == 2 and "theta_y" in trip.message


def test_the_watchdog_waits_for_its_time_and_only_where_something_is_held() -> None:
    host = Host()
    host.now_s += 1000.0
    assert host.status().state.value == "idle"  # safe anyway: nothing to guard
    host.say("SYST:WATC 2")
    host.start(sine(1e-4, 100))
    host.until_computed()
    host.now_s += 1.9
    assert host.status().state.value == "done"
    host.say("SYST:BEAT")
    host.now_s += 1.9
    assert host.status().state.value == "done"
    host.now_s += 0.2
    assert host.status().state.value == "fault"
    assert host.journal[-1] == ("fault", "watchdog: the host was silent for more than 2 s")
    assert host.say(f"REC? {host.run}").startswith("100,")  # what was measured stays to be had


def test_somebody_elses_questions_do_not_keep_the_bench_awake() -> None:
    host = Host()
    host.start(sine(1e-4, 100))
    host.until_computed()
    for _ in range(6):
        host.now_s += 1.0
        status = host.status()  # asked without the lock
    assert status.state.value == "fault"


def test_a_lock_is_not_taken_from_a_host_that_is_heard() -> None:
    host = Host()
    host.now_s += 4.0
    assert host.say("SYST:LOCK you", holder=None).startswith("ERR 104")
    assert host.say("ARM 1,100,0", holder="you").startswith("ERR 104")
    host.now_s += 2.0
    assert host.say("SYST:LOCK you", holder=None) == "OK 100,0"
    assert host.say("SYST:WATC 5", holder="me").startswith("ERR 104")


def test_anybody_may_abort() -> None:
    host = Host(speed=1.0)
    host.start(sine(1e-4))
    assert host.status().state.value == "running"
    assert host.say("ABORt", holder=None, tag=None) == "OK 100,1"
    assert host.status().state.value == "idle"


def test_what_changes_something_needs_a_checksum() -> None:
    host = Host()
    assert host.say("SYST:WATC 9", tag=None).startswith("ERR -203")


def test_time_passes_at_the_pace_that_is_asked_for() -> None:
    host = Host(speed=1.0)
    host.start(sine(1e-4))
    time.sleep(0.3)  # computed by then, but its second has not passed
    host.now_s += 0.25
    status = host.status()
    assert (status.state.value, status.played) == ("running", 2500)
    host.now_s += 0.76
    end_s = time.monotonic() + 10.0
    while host.status().state.value == "running" and time.monotonic() < end_s:
        time.sleep(0.01)
    assert host.status().state.value == "done"


def test_a_restart_forgets_everything_and_is_told_apart() -> None:
    host = Host()
    host.start(sine(1e-4, 100))
    host.until_computed()
    host.firmware.restart()
    status = host.status()
    assert (status.state.value, status.boot, status.epoch, status.run) == ("idle", 101, 0, 0)
    assert host.say(f"REC? {host.run}", holder="me").startswith("ERR -230")
    assert host.say("SYST:WATC 5").startswith("ERR 104")


def test_the_error_queue_overflows_as_scpi_says() -> None:
    host = Host()
    for _ in range(ERROR_QUEUE + 5):
        host.say("NO:SUCH")
    codes = [int(host.say("SYST:ERR?").split(",")[0]) for _ in range(ERROR_QUEUE + 1)]
    assert codes == [-113] * (ERROR_QUEUE - 1) + [-350, 0]


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("SEGM:BEG 1,2", -109),
        ("SEGM:BEG 1,-2,3", -109),
        ("SEGM:BEG 0,10,0", -222),
        ("SEGM:BEG 1,0,0", -223),
        ("SEGM:BEG 1,999999999999,0", -223),
        ("SEGM:DATA 5,0,1", -230),
        ("SYST:WATC 0", -222),
        ("SYST:WATC nan", -222),
        ("SYST:LOCK", -109),
        ("ARM 1,100,1", -230),
        ("ARM 1,100,0", -221),
        ("INIT 1", -221),
        ("REC:DATA? 1,0,1", -230),
        ("FIRE", -113),
    ],
)
def test_refusals(text: str, code: int) -> None:
    assert Host().say(text).startswith(f'ERR {code},"')


def test_an_image_with_a_wrong_checksum_is_not_armed() -> None:
    host = Host()
    image = encode_segment(sine(1e-4, 10), tuple(s.name for s in host.bench.signals))
    host.say(f"SEGM:BEG 1,{len(image)},{crc32(image) ^ 1}")
    for block in split(image, 1):
        host.firmware.store(block, block.sequence)
    assert host.say("ARM 1,100,0").startswith("ERR -230")


def test_blocks_of_another_run_or_place_are_not_taken() -> None:
    host = Host()
    assert host.say("SEGM:BEG 3,3000,0") == "OK 0"
    blocks = split(bytes(3000), 3)
    assert not host.firmware.store(blocks[1], 0)
    assert not host.firmware.store(split(bytes(3000), 2)[0], 0)
    assert host.firmware.store(blocks[0], 0) and host.firmware.next_block() == 1
    assert host.firmware.store(blocks[0], 0) and host.firmware.next_block() == 1  # once more does nothing
