"""The vocabulary: headers in long and short form, states, error numbers, and how replies are written."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum, IntEnum

PROTOCOL = "MCCD/1"


class State(Enum):
    """What the bench is doing; only `idle` and `fault` promise that all drives are zero and all loops open."""

    IDLE = "idle"
    ARMED = "armed"
    RUNNING = "running"
    DONE = "done"
    FAULT = "fault"


class Code(IntEnum):
    """Error numbers: SCPI's where it has one, positive for what this bench adds."""

    NONE = 0
    PARAMETER = -109
    UNKNOWN = -113
    PROTECTED = -203
    CONFLICT = -221
    RANGE = -222
    TOO_MUCH = -223
    STALE = -230
    HARDWARE = -240
    OVERFLOW = -350
    OVER_TRAVEL = 101
    OVER_CURRENT = 102
    WATCHDOG = 103
    LOCKED = 104
    TRIPPED = 105
    TOKEN = 106


HEADERS = {
    "*IDN?": "*IDN?",
    "*CLS": "*CLS",
    "SYSTEM:VERSION?": "SYST:VERS?",
    "SYSTEM:ERROR?": "SYST:ERR?",
    "SYSTEM:DESCRIBE?": "SYST:DESC?",
    "SYSTEM:CHALLENGE?": "SYST:CHAL?",
    "SYSTEM:AUTHENTICATE": "SYST:AUTH",
    "SYSTEM:LOCK": "SYST:LOCK",
    "SYSTEM:UNLOCK": "SYST:UNL",
    "SYSTEM:BEAT": "SYST:BEAT",
    "SYSTEM:WATCHDOG": "SYST:WATC",
    "STATUS?": "STAT?",
    "SEGMENT:BEGIN": "SEGM:BEG",
    "SEGMENT:DATA": "SEGM:DATA",
    "ARM": "ARM",
    "INITIATE": "INIT",
    "ABORT": "ABOR",
    "RECORD?": "REC?",
    "RECORD:DATA?": "REC:DATA?",
}
"""Every command: long form to short form. Either is understood, in any case."""

_LONG = {form: long for long, short in HEADERS.items() for form in (long, short)}

UNCHECKED = frozenset(long for long in HEADERS if long.endswith("?") and not long.startswith("RECORD:DATA")) | {"ABORT"}
"""What is carried out without tag and checksum, for a person at a terminal: questions, and what makes it safe."""

UNLOCKED = frozenset(long for long in HEADERS if long.endswith("?")) | {
    "ABORT",
    "SYSTEM:AUTHENTICATE",
    "SYSTEM:LOCK",
    "SYSTEM:BEAT",
}
"""What needs no lock."""


GREETINGS = frozenset({"*IDN?", "ABORT"})
"""One of these, alone on its line, begins every TCP connection; no request of a web page can look like that."""

NO_CHALLENGE = "none"
"""What a bench without a token answers to SYSTem:CHALlenge?."""


@dataclass(frozen=True)
class Command:
    """A command by its long form, with its parameters as text."""

    header: str
    parameters: tuple[str, ...]


def parse_command(text: str) -> Command | None:
    """Return the command in a line's text, None for a header that does not exist."""
    header, _, rest = text.partition(" ")
    long = _LONG.get(header.upper())
    return None if long is None else Command(long, tuple(p.strip() for p in rest.split(",")) if rest.strip() else ())


@dataclass(frozen=True)
class Status:
    """The answer to STATus?: `boot` changes with every start, `epoch` with every entry into the safe state."""

    state: State
    boot: int
    epoch: int
    run: int
    played: int
    waiting: bool
    errors: int


def format_status(status: Status) -> str:
    """Return the text of a status."""
    return ",".join(
        str(v)
        for v in (
            status.state.value,
            status.boot,
            status.epoch,
            status.run,
            status.played,
            int(status.waiting),
            status.errors,
        )
    )


def parse_status(text: str) -> Status | None:
    """Return the status in a reply, None when it holds none."""
    words = text.split(",")
    if len(words) != 7 or words[0] not in {s.value for s in State} or not all(w.isdecimal() for w in words[1:]):
        return None
    boot, epoch, run, played, waiting, errors = (int(w) for w in words[1:])
    return Status(State(words[0]), boot, epoch, run, played, bool(waiting), errors)


@dataclass(frozen=True)
class Failure:
    """An error as the bench tells it."""

    code: int
    message: str


_ERROR = re.compile(r'^(-?\d{1,6}),"([^"]*)"?$')


def format_error(code: int, message: str) -> str:
    """Return `code,"message"` as SYSTem:ERRor? answers."""
    quoted = message.replace('"', "'")
    return f'{int(code)},"{quoted}"'


def parse_error(text: str) -> Failure | None:
    """Return the error in `code,"message"`, None when it holds none; a message that was cut has no closing quote."""
    found = _ERROR.match(text)
    return None if found is None else Failure(int(found[1]), found[2])
