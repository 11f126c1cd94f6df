"""What all kinds of sources refuse in the same words."""

from __future__ import annotations

from pathlib import Path

from campaigns.log.guard import first_line, most_bytes, refuse
from sim_backend.errors import DataError


def check_expansion(path: Path, item: str, size: int, stored: int) -> None:
    """Raise DataError when `item` of `size` bytes is stored in so few that it must be a bomb."""
    limit = most_bytes(stored)
    if size > limit:
        what = f"unpacks to {size} bytes of at most {limit} for {stored} stored bytes"
        raise refuse(path, item, what, "store it with less compression")


def unreadable(path: Path, error: Exception) -> DataError:
    """Return the error for a file whose parser failed."""
    if isinstance(error, MemoryError):
        return DataError(f"{path} takes more memory to read than its size allows: store it with less compression")
    return DataError(f"cannot read {path}: {first_line(error)}; check that it is what its suffix says")
