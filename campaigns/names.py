"""What may be a name: of a channel, a run, a campaign, a test or a segment. Some of them become names of files."""

from __future__ import annotations

import re

from sim_backend.errors import ConfigError

MAX_NAME_BYTES = 128
_TEXT_NAME = re.compile(r"[^/\x00-\x1f\x7f]+")


def check_name(name: str, what: str) -> None:
    """Raise ConfigError unless `name` can be a name: 1 to 128 bytes of UTF-8, no `/`, no control sign."""
    try:
        size = len(name.encode("utf-8"))
    except UnicodeEncodeError:
        size = 0
    if not (0 < size <= MAX_NAME_BYTES and _TEXT_NAME.fullmatch(name) and name.strip(". ")):
        raise ConfigError(
            f"{what} {name[:60]!r} cannot be a name: use 1 to {MAX_NAME_BYTES} bytes of text "
            "without '/' and control signs"
        )


def check_label(label: str, what: str = "segment label") -> None:
    """Raise ConfigError unless `label` can name a segment or a test: as `check_name`, with `/` allowed."""
    check_name(label.replace("/", " "), what)
