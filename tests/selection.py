"""What `make test` leaves to `make test-all`: the one place that decides, with the reason."""

from __future__ import annotations

from fnmatch import fnmatchcase

THOROUGH: tuple[tuple[str, str], ...] = ()
"""Patterns of node IDs below tests/, and why these tests are left to the longer run."""


def is_thorough(nodeid: str) -> bool:
    """Tell whether a test runs in `make test-all` only."""
    return any(fnmatchcase(nodeid, f"tests/{pattern}") for pattern, _ in THOROUGH)
