"""Who may speak on a connection: what begins it, and what a token is asked for; whatever the bytes are."""

from __future__ import annotations

import hashlib
import hmac
import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.serial.answers import Reply
from campaigns.serial.commands import HEADERS
from campaigns.serial.firmware import Firmware
from campaigns.serial.frames import Line, Receiver, encode_line
from campaigns.serial.guard import GREETING_BYTES, Guard, NoGreeting, answer_to
from campaigns.serial.session import Session
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model

TOKEN = b"a token of some length"
METHODS = st.one_of(st.sampled_from([*HEADERS, *HEADERS.values(), "GET", "POST"]), st.text("ABOR*IDN?t ", max_size=9))
HEADER_LINES = st.lists(st.sampled_from(["Host: x", "*IDN?", "ABORt", "", "Content-Type: text/plain"]), max_size=6)


def guard(token: bytes | None = None) -> Guard:
    return Guard(token, lambda _why: None)


@pytest.mark.parametrize(
    "said", [b"*IDN?\n", b"ABORt\r\n", b"abor\n", b"\n\r\n*idn?\n", encode_line("*IDN?", 7), encode_line("ABOR", 1)]
)
def test_a_greeting_in_pieces_of_any_size(said: bytes) -> None:
    whole, piecewise = guard(), guard()
    assert whole.greet(said + b"STAT?\n") == said + b"STAT?\n" and whole.admits
    seen = b"".join(piecewise.greet(said[i : i + 1]) for i in range(len(said)))
    assert seen == said and piecewise.admits
    assert piecewise.greet(b"\xff anything") == b"\xff anything"


@pytest.mark.parametrize(
    "said",
    [
        b"STAT?\n",
        b"*IDN? 1\n",
        b"ABOR / HTTP/1.1\r\n",
        b"*IDN? HTTP/1.1\r\n",
        b"\x16\x03\x01\x02\x00\n",
        encode_line("*IDN?", 7).replace(b"*IDN", b"*IDM"),
        b"\n" * (GREETING_BYTES + 1),
        b"x" * (GREETING_BYTES + 1),
        b" " * GREETING_BYTES + b"*IDN?\n",
    ],
)
def test_what_is_no_greeting(said: bytes) -> None:
    with pytest.raises(NoGreeting, match="is not a greeting"):
        guard().greet(said)


@given(METHODS, st.text("/*IDN?ABORt ", max_size=20), st.sampled_from(["1.0", "1.1", "2"]), HEADER_LINES)
def test_no_request_of_a_browser_is_a_greeting(method: str, target: str, version: str, lines: list[str]) -> None:
    """Whatever method and target a page chooses, its first line ends in the version, which the browser puts there."""
    request = "\r\n".join([f"{method} /{target} HTTP/{version}", *lines, "", "ABORt"]) + "\r\n"
    with pytest.raises(NoGreeting):
        guard().greet(request.encode())


@given(st.binary(max_size=200))
def test_any_bytes_are_a_greeting_or_none(data: bytes) -> None:
    one = guard()
    try:
        seen = one.greet(data)
    except NoGreeting:
        return
    assert seen in (b"", data) and one.admits == bool(seen)


class Talk:
    """Requests and answers with a bench that asks for its token."""

    def __init__(self, token: bytes | None = TOKEN) -> None:
        self.remarks: list[str] = []
        self.firmware = Firmware(SimBench(bench_model(), 1), itertools.count(1))
        self.guard = Guard(token, self.remarks.append)
        self.session = Session(self.firmware, self.guard)
        self.guard.greet(b"*IDN?\n")

    def say(self, text: str) -> str:
        self.session.feed(encode_line(text, 1), 0.0)
        receiver = Receiver()
        receiver.feed(b"".join(iter(self.session.next_bytes, b"")))
        line = receiver.line()
        assert line is not None and line.tag == 1
        return line.text


def test_everything_but_stopping_and_asking_who_it_is_needs_the_token() -> None:
    talk = Talk()
    for header, short in HEADERS.items():
        if header not in ("*IDN?", "ABORT", "SYSTEM:CHALLENGE?"):
            assert talk.say(short).startswith("ERR 106,"), header
    assert talk.say("SYST:LOCK me").startswith("ERR 106,") and talk.firmware.owner is None
    assert talk.say("ABOR") == "OK 1,0" and talk.say("*IDN?").count(",") == 3
    assert not talk.guard.admits


def test_the_token_is_shown_by_an_answer_that_only_its_owner_can_give() -> None:
    talk = Talk()
    challenge = talk.say("SYST:CHAL?")
    expected = hmac.digest(TOKEN, b"mccd-token-1:" + challenge.encode(), hashlib.sha256).hex()  # as documented
    assert answer_to(TOKEN, challenge) == expected
    assert talk.say(f"SYST:AUTH {expected}") == "OK"
    assert talk.guard.admits and talk.say("SYST:LOCK me") == "OK 1,0"
    assert talk.say(f"SYST:AUTH {expected}") == "OK"  # the answer was lost and the host asks again


def test_an_answer_is_good_once_and_for_its_challenge_alone() -> None:
    first, second = Talk(), Talk()
    answer = answer_to(TOKEN, first.say("SYST:CHAL?"))
    assert first.say("SYST:AUTH 00").startswith("ERR 106,")
    assert first.say(f"SYST:AUTH {answer}").startswith("ERR 106,")  # the challenge is used up
    second.say("SYST:CHAL?")
    assert second.say(f"SYST:AUTH {answer}").startswith("ERR 106,")
    assert Talk().say(f"SYST:AUTH {answer_to(TOKEN, '')}").startswith("ERR 106,")  # none was asked for
    assert not first.guard.admits and len(first.remarks) == 2
    assert TOKEN.decode() not in " ".join(first.remarks)


def test_a_bench_without_a_token_says_so() -> None:
    talk = Talk(None)
    assert talk.say("SYST:CHAL?") == "none" and talk.say("SYST:AUTH 00") == "OK"
    assert isinstance(talk.firmware.handle(Line("SYST:CHAL?"), None, 0.0), Reply)
