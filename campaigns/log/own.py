"""Logs that this very process has written: nobody has to look at them first.

What is known is in memory only. A checksum beside a file says that the file is as somebody left it, not who.
"""

from __future__ import annotations

import os
from pathlib import Path

_open: set[tuple[int, int]] = set()
_closed: set[tuple[int, ...]] = set()


def begin(path: Path) -> tuple[int, int]:
    """Remember that the file at `path` is being written here, until `end` is given what this returns."""
    which = _which(path.stat())
    _open.add(which)
    return which


def end(which: tuple[int, int]) -> None:
    """Forget a file that is no longer written here."""
    _open.discard(which)


def keep(path: Path) -> None:
    """Remember the file at `path` as it was left here."""
    _closed.add(_state(path.stat()))


def is_own(path: Path) -> bool:
    """Tell whether the file at `path` is being written here, or is as it was left here."""
    try:
        found = path.stat()
    except OSError:
        return False
    return _which(found) in _open or _state(found) in _closed


def _which(found: os.stat_result) -> tuple[int, int]:
    return found.st_dev, found.st_ino


def _state(found: os.stat_result) -> tuple[int, ...]:
    # the time of the last change cannot be set back, as that of the last writing can
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns, found.st_ctime_ns
