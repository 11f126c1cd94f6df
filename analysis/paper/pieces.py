"""What one contradiction of the paper consists of, and how its numbers are shown."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Evidence:
    """One contradiction: what stands against what, numbers as text cells under `heads`, and what follows."""

    title: str
    question: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    conclusion: str


def shown(value: float | None) -> str:
    """Return a printed number as the paper shows it; nothing for one that it leaves out."""
    return "" if value is None else f"{value:g}"
