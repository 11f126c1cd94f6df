"""One conversation, byte by byte: uploads that go wrong, answers that are cut off, and any bytes at all."""

from __future__ import annotations

import itertools
from zlib import crc32

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from campaigns.serial.firmware import Firmware
from campaigns.serial.frames import Receiver, encode_block, encode_line, split
from campaigns.serial.program import encode_segment
from campaigns.serial.session import SILENCE_S, Session
from sim_backend.bench import Segment
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model

MODEL = bench_model()
NAMES = tuple(signal.name for signal in SimBench(MODEL, 1).signals)
IMAGE = encode_segment(
    Segment("s", 100, np.zeros((200, 3)), 1e-5 * np.random.default_rng(0).standard_normal((200, 3))), NAMES
)
BLOCKS = split(IMAGE, 1)


class Talk:
    """A host's bytes and the bench's, at times that the test chooses."""

    def __init__(self) -> None:
        self.firmware = Firmware(SimBench(MODEL, 1), itertools.count(1))
        self.session = Session(self.firmware)
        self.now_s = 0.0
        self.tags = itertools.count(1)

    def send(self, text: str, payload: bytes = b"") -> list[str]:
        """Send a request and return what is answered at once under its tag."""
        self.tag = next(self.tags)
        self.session.feed(encode_line(text, self.tag) + payload, self.now_s)
        return self.answers()

    def answers(self) -> list[str]:
        receiver = Receiver()
        receiver.feed(b"".join(iter(self.session.next_bytes, b"")))
        lines = iter(receiver.line, None)
        return [line.text for line in lines if line.tag == self.tag]

    def begin(self) -> None:
        assert self.send("SYST:LOCK me") == ["OK 1,0"]
        assert self.send(f"SEGM:BEG 1,{len(IMAGE)},{crc32(IMAGE)}") == ["OK 0"]


@pytest.fixture
def talk() -> Talk:
    return Talk()


def test_an_upload_in_pieces_of_any_size(talk: Talk) -> None:
    talk.begin()
    payload = b"".join(map(encode_block, BLOCKS))
    assert talk.send(f"SEGM:DATA 1,0,{len(BLOCKS)}", payload[:1]) == []
    for i in range(1, len(payload)):
        talk.session.feed(payload[i : i + 1], talk.now_s)
    assert talk.answers() == [f"OK {len(BLOCKS)}"]
    assert talk.send("ARM 1,1,0") == ["OK"]


def test_a_damaged_block_and_the_rest_sent_again(talk: Talk) -> None:
    talk.begin()
    payload = bytearray(b"".join(map(encode_block, BLOCKS)))
    payload[1500] ^= 1  # in the second block
    assert talk.send(f"SEGM:DATA 1,0,{len(BLOCKS)}", bytes(payload)) == ["OK 1"]
    again = b"".join(map(encode_block, BLOCKS[1:]))
    assert talk.send(f"SEGM:DATA 1,1,{len(BLOCKS) - 1}", again) == [f"OK {len(BLOCKS)}"]


def test_lost_bytes_are_noticed_by_silence(talk: Talk) -> None:
    talk.begin()
    payload = b"".join(map(encode_block, BLOCKS))
    assert talk.send(f"SEGM:DATA 1,0,{len(BLOCKS)}", payload[:-5]) == []
    talk.session.tick(talk.now_s + 0.9 * SILENCE_S)
    assert talk.answers() == []
    talk.session.tick(talk.now_s + 1.1 * SILENCE_S)
    assert talk.answers() == [f"OK {len(BLOCKS) - 1}"]
    assert talk.send("SYST:VERS?") == ["MCCD/1"]  # and the conversation goes on


def test_a_new_question_cuts_the_answer_to_the_one_before(talk: Talk) -> None:
    talk.begin()
    talk.tag = next(talk.tags)
    talk.session.feed(encode_line("SYST:DESC? 0,9", talk.tag), 0.0)
    assert talk.session.next_bytes().startswith(b"\n0,")
    assert talk.session.next_bytes().startswith(b"#4")
    assert talk.send("SYST:VERS?") == ["MCCD/1"]
    assert talk.session.next_bytes() == b""


def test_a_beat_cuts_nothing(talk: Talk) -> None:
    talk.begin()
    talk.session.feed(encode_line("SYST:DESC? 0,9", 7), 0.0)
    first = talk.session.next_bytes()
    talk.session.feed(encode_line("SYST:BEAT", 8), 0.0)
    assert first and talk.session.next_bytes().startswith(b"#4")


def test_another_host_on_the_same_line_does_not_keep_the_watchdog_quiet(talk: Talk) -> None:
    """A killed host's line is open to the next one, whose every question reaches the bench by the same session."""
    talk.begin()
    talk.send(f"SEGM:DATA 1,0,{len(BLOCKS)}", b"".join(map(encode_block, BLOCKS)))
    assert talk.send("ARM 1,1,0") == ["OK"]
    for _ in range(6):
        talk.now_s += 1.0
        answer = talk.send("SYST:LOCK you")
        talk.send("STAT?")
        talk.firmware.tick(talk.now_s)
        if talk.now_s <= 5.0:
            assert answer[0].startswith("ERR 104")
    assert talk.send("STAT?")[0].startswith("fault,1,0,1,")  # armed, but no drive was held: the epoch stays
    assert answer == ["OK 1,0"]  # and the lock has fallen to the host that asks


def test_the_host_that_holds_the_lock_may_ask_for_it_again(talk: Talk) -> None:
    talk.begin()
    assert talk.send("SYST:LOCK me") == ["OK 1,0"]
    assert talk.send("SYST:LOCK you")[0].startswith("ERR 104")
    assert talk.send("ARM 1,1,0")[0].startswith("ERR 104")  # you are not me
    assert talk.send("SYST:LOCK me") == ["OK 1,0"]
    assert talk.send("SYST:WATC 4") == ["OK 4"]


@settings(max_examples=300)
@given(st.lists(st.one_of(st.binary(max_size=80), st.sampled_from([encode_line(t, 5) for t in (
    "SYST:LOCK me", "SEGM:BEG 1,3000,7", "SEGM:DATA 1,0,3", "ARM 1,1,0", "INIT 1", "REC? 1", "STAT?", "ABOR", "*CLS",
)])), max_size=12))  # fmt: skip
def test_no_bytes_stop_the_firmware(pieces: list[bytes]) -> None:
    talk = Talk()
    for piece in pieces:
        talk.session.feed(piece, talk.now_s)
        talk.now_s += 0.1
        talk.session.tick(talk.now_s)
    talk.now_s += 1.0  # whatever was announced has fallen silent
    talk.session.tick(talk.now_s)
    assert talk.send("SYST:VERS?") == ["MCCD/1"]
    assert talk.firmware.safe  # nothing was played
