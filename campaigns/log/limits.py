"""What a log may hold and what reading one may take: one set of limits, kept when it is written and when it is read."""

from __future__ import annotations

from unicodedata import category

from sim_backend.errors import ConfigError

MAX_CHANNELS = 4096
MAX_SEGMENTS = 200_000
MAX_SEGMENT_TABLE_BYTES = 256 * 2**20
MAX_SETTINGS_BYTES = 2**16
MAX_TEXT_BYTES = 16 * 2**20
MAX_CHUNK_ROWS = 2**20
MAX_CHUNK_BYTES = 64 * 2**20
"""A chunk is what has to be decompressed at once."""

MAX_EXPANSION = 100
"""Deflate achieves 1032:1 on constant data. Measured data stay below 20:1, so 100:1 allows for quiet channels while a
bomb stays within 100 times its own size."""

FREE_BYTES = 256 * 2**20
"""Below this size the expansion does not matter: a square wave compresses to nothing."""

BLOCK_ROWS = 65536
BLOCK_VALUES = 2**24
"""What is read at once, over all channels: 128 MiB, a chunk of the default size of the largest number of channels."""

CHUNK_CACHES_BYTES = 64 * 2**20
CHUNK_CACHE_BYTES = 2**20
"""Chunks that HDF5 keeps unpacked: for all channels of a log, and at most for one."""

CHUNK_SLOTS = 67
"""Of one of many channels: HDF5 keeps a table of 64 KiB else, however few chunks it may keep."""

READER_BYTES = 384 * 2**20
"""What the process that looks at a foreign file may take, beside Python and its libraries."""

MAX_NOTE_CHARS = 500

NO_NOTE = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
"""Unicode categories that no note may hold: controls, invisible signs, halves of signs, ends of lines."""


def check_note(note: str) -> None:
    """Raise ConfigError for a note that is not a single line of up to MAX_NOTE_CHARS characters."""
    if len(note) > MAX_NOTE_CHARS:
        raise ConfigError(f"the note has {len(note)} characters of at most {MAX_NOTE_CHARS}: shorten it")
    if any(category(sign) in NO_NOTE for sign in note):
        raise ConfigError(f"the note {note[:60]!r} holds line breaks or control characters: write it in one line")


def readable_note(note: str) -> str:
    """Return the note of a log with what `check_note` would not take written out, in MAX_NOTE_CHARS characters."""
    told = "".join(ascii(sign)[1:-1] if category(sign) in NO_NOTE else sign for sign in note)
    grown = len(note) <= MAX_NOTE_CHARS < len(told)
    return f"{told[: MAX_NOTE_CHARS - 1]}…" if grown else told


def check_text(text: str, what: str) -> None:
    """Raise ConfigError for a text of a header that no reader would take."""
    size = len(text.encode("utf-8", "replace"))
    if size > MAX_TEXT_BYTES:
        raise ConfigError(f"{what} takes {size} bytes of at most {MAX_TEXT_BYTES} in a log: shorten it")


def check_channels(count: int) -> None:
    """Raise ConfigError for more channels than a log may have."""
    if count > MAX_CHANNELS:
        raise ConfigError(f"{count} channels of at most {MAX_CHANNELS} in one log: spread them over several logs")


def check_segments(count: int, row_bytes: int) -> None:
    """Raise ConfigError for more segments than a log may have, each of `row_bytes` in its table."""
    most = min(MAX_SEGMENTS, MAX_SEGMENT_TABLE_BYTES // row_bytes)
    if count > most:
        raise ConfigError(
            f"{count} segments of at most {most} in one log, with {row_bytes} bytes each: spread the run over several "
            "logs, or join segments"
        )
