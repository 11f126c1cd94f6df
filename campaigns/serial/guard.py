"""Who may speak on a TCP connection: first a greeting that no web page can send, then the token if there is one."""

from __future__ import annotations

import hashlib
import hmac
import secrets
from collections.abc import Callable

from campaigns.serial.answers import Reply
from campaigns.serial.commands import GREETINGS, Code, format_error, parse_command
from campaigns.serial.frames import Line, parse_line

GREETING_BYTES = 64
"""What may come up to the end of the greeting; with its trailer it takes 21 bytes, empty lines before it some."""

_CONTEXT = b"mccd-token-1:"
"""Stands before what is signed, so that an answer to a challenge is good for nothing else."""


class NoGreeting(Exception):  # noqa: N818 - it is a finding about a connection, not a failure of this program
    """A connection begins with something else than a greeting; nothing of it may be carried out."""


def is_greeting(line: Line | None) -> bool:
    """Return whether a line is a greeting: the command alone, without parameters."""
    command = None if line is None else parse_command(line.text)
    return command is not None and command.header in GREETINGS and not command.parameters


def answer_to(token: bytes, challenge: str) -> str:
    """Return what proves knowledge of `token`: HMAC-SHA-256 of the challenge, 64 hexadecimal digits."""
    return hmac.new(token, _CONTEXT + challenge.encode("ascii"), hashlib.sha256).hexdigest()


class Guard:
    """Stands before one connection's session; `remark` is called for what is refused. Holds no clock.

    Without a `token` a greeting is enough. With one, only a greeting is carried out before the token is shown.
    """

    def __init__(self, token: bytes | None, remark: Callable[[str], None]) -> None:
        self._token = token
        self._remark = remark
        self._begun = bytearray()
        self._greeted = False
        self._shown = token is None
        self._challenge: str | None = None

    @property
    def admits(self) -> bool:
        """Whether everything is carried out from now on."""
        return self._greeted and self._shown

    def greet(self, data: bytes) -> bytes:
        """Return the bytes that the session may see: none before a whole greeting. Raises NoGreeting."""
        if self._greeted:
            return data
        self._begun += data
        whole, end, _ = bytes(self._begun[:GREETING_BYTES]).lstrip(b"\r\n").partition(b"\n")
        if end and is_greeting(parse_line(whole.rstrip(b"\r"))):
            self._greeted = True
            return bytes(self._begun)
        if end or len(self._begun) >= GREETING_BYTES:
            raise NoGreeting(f"it begins with '{_readable(whole)}', which is not a greeting")
        return b""

    def refusal(self, line: Line) -> Reply | None:
        """Return the answer to a line that the firmware must not see, None for one that it may."""
        command = parse_command(line.text)
        header = "" if command is None else command.header
        if self._token is None:
            return None
        if header == "SYSTEM:CHALLENGE?":
            self._challenge = secrets.token_hex(16)
            return Reply(self._challenge)
        if command is not None and header == "SYSTEM:AUTHENTICATE":
            return self._authenticate(self._token, ",".join(command.parameters))
        if self._shown or is_greeting(line):
            return None
        return _refused("this bench asks for its token; set MCCD_BENCH_TOKEN or MCCD_BENCH_TOKEN_FILE")

    def _authenticate(self, token: bytes, given: str) -> Reply:
        challenge, self._challenge = self._challenge, None  # each is good for one try
        right = challenge is not None and hmac.compare_digest(answer_to(token, challenge).encode(), given.encode())
        if not (right or self._shown):  # once shown it stays shown, for the answer may get lost and be asked for again
            self._remark("a wrong token was shown")
            return _refused("the token is wrong, or no challenge was asked for; compare it with the bench's")
        self._shown = True
        return Reply("OK")


def _refused(message: str) -> Reply:
    return Reply(f"ERR {format_error(Code.TOKEN, message)}")


def _readable(raw: bytes) -> str:
    return raw[:40].decode("ascii", "backslashreplace").encode("unicode_escape").decode("ascii")
