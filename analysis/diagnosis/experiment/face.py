"""The public face of a bench: what it is and may be asked, kept after it was let go; nothing can be moved with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

from sim_backend.bench import Bench, Identity, Limits, Record, Segment, Signal
from sim_backend.errors import ConfigError


@dataclass(frozen=True)
class Face:
    """A bench's identity, channels, axes and limits: all that plans and proposals need."""

    identity: Identity
    signals: tuple[Signal, ...]
    axes: tuple[str, ...]
    limits: Limits

    @classmethod
    def of(cls, bench: Bench) -> Self:
        """Return the face of a bench."""
        return cls(bench.identity, bench.signals, bench.axes, bench.limits)

    def play(self, segment: Segment) -> Record:
        """Raise ConfigError: there is no bench behind it."""
        raise ConfigError(f"segment '{segment.label}' cannot be played: the bench has been let go; open it again")

    def safe(self) -> None:
        """Nothing moves."""

    def close(self) -> None:
        """Nothing is held."""
