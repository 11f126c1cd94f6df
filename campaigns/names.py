"""What may be a name: of a channel, a run, a campaign, a test or a segment. Some of them become names of files."""

from __future__ import annotations

import re

from sim_backend.errors import ConfigError

MAX_NAME_BYTES = 128
MAX_FILE_NAME_BYTES = 100
"""With the endings that a file and its hidden forerunner get, it stays below the 255 bytes of file systems."""
_TEXT_NAME = re.compile(r"[^/\x00-\x1f\x7f]+")
_FILE_NAME = re.compile(r"(?!\.)[^/\\\x00-\x1f\x7f-\x9f]+")


def check_name(name: str, what: str) -> None:
    """Raise ConfigError unless `name` can be a name: 1 to 128 bytes of UTF-8, no `/`, no control sign."""
    if not (0 < _size_bytes(name) <= MAX_NAME_BYTES and _TEXT_NAME.fullmatch(name) and name.strip(". ")):
        raise ConfigError(
            f"{what} {name[:60]!r} cannot be a name: use 1 to {MAX_NAME_BYTES} bytes of text "
            "without '/' and control signs"
        )


def check_file_name(name: str, what: str) -> None:
    """Raise ConfigError unless `name`, which comes from a file, can name another file or folder in a chosen one.

    That is 1 to 100 bytes of UTF-8 that begin with no dot, without slashes of either kind and control characters.
    """
    if not (0 < _size_bytes(name) <= MAX_FILE_NAME_BYTES and _FILE_NAME.fullmatch(name) and name.strip()):
        raise ConfigError(
            f"{what} {name[:60]!r} cannot be a name: use 1 to {MAX_FILE_NAME_BYTES} bytes of text that begin with "
            "no dot, without '/', '\\' and control characters"
        )


def check_label(label: str, what: str = "segment label") -> None:
    """Raise ConfigError unless `label` can name a segment or a test: as `check_name`, with `/` allowed."""
    check_name(label.replace("/", " "), what)


def _size_bytes(name: str) -> int:
    """Return the length as UTF-8, 0 for what UTF-8 cannot hold."""
    try:
        return len(name.encode("utf-8"))
    except UnicodeEncodeError:
        return 0
