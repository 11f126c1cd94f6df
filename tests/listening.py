"""Somebody who is told how far long work is."""

from __future__ import annotations


class Listener:
    """Keeps what it is told: shares of the whole, and what was being done."""

    def __init__(self) -> None:
        self.shares: list[float] = []
        self.said: list[str] = []

    def __call__(self, done: float, total: float, what: str) -> None:
        self.shares.append(done / total)
        self.said.append(what)
