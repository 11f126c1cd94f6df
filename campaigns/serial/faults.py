"""Seeded faults of a line: flipped, lost, repeated and delayed bytes, garbage, disconnects, resets and stalls.

Each kind strikes at byte positions drawn beforehand, so that a seed gives the same faults however the bytes are cut
into pieces on their way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import msgspec
import numpy as np

from sim_backend.errors import ConfigError

Kind = Literal["flip", "lose", "repeat", "garbage", "delay", "drop", "reset", "stall"]


class FaultSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """How often each fault strikes, per byte on the line.

    A bit of a byte is flipped; up to 20 bytes are lost or repeated; up to 40 random ones are put in; what follows is
    delayed by up to 1 s; the link is dropped; the firmware restarts; the firmware stalls, deaf and dumb, for up to 4 s.
    """

    flip: float = 0.0
    lose: float = 0.0
    repeat: float = 0.0
    garbage: float = 0.0
    delay: float = 0.0
    drop: float = 0.0
    reset: float = 0.0
    stall: float = 0.0

    def __post_init__(self) -> None:
        for kind in KINDS:
            if not 0.0 <= getattr(self, kind) <= 0.5:
                raise ConfigError(f"faults: {kind} is {getattr(self, kind)} per byte; it must lie in 0 to 0.5")


KINDS: tuple[Kind, ...] = ("flip", "lose", "repeat", "garbage", "delay", "drop", "reset", "stall")


def parse_faults(text: str) -> tuple[int, FaultSpec]:
    """Return seed and rates of `SEED` (kinds and rates drawn from it) or `SEED/kind=rate,…`; raises ConfigError."""
    number, _, rates = text.partition("/")
    if not number.isdecimal():
        raise ConfigError(f"faults '{text}': wanted SEED or SEED/kind=rate,…; the kinds are {', '.join(KINDS)}")
    if not rates:
        return int(number), drawn_spec(int(number))
    try:
        given = {kind: float(rate) for kind, rate in (word.split("=") for word in rates.split(","))}
        return int(number), msgspec.convert(given, FaultSpec)
    except (ValueError, msgspec.ValidationError) as error:
        raise ConfigError(f"faults '{text}': {error}; the kinds are {', '.join(KINDS)}, as in 7/flip=1e-4") from None


def drawn_spec(seed: int) -> FaultSpec:
    """Return rates from a seed: one to three kinds; those of the line from 1 in 100,000 bytes to 1 in 1,000.

    What ends a conversation (drop, reset, stall) strikes from once in a million bytes to once in 10,000.
    """
    rng = np.random.default_rng([seed, 1])
    kinds = rng.choice(len(KINDS), size=int(rng.integers(1, 4)), replace=False)
    rates: dict[str, float] = {}
    for i in sorted(kinds.tolist()):
        kind = KINDS[i]
        low, high = (-6.0, -4.0) if kind in ("drop", "reset", "stall") else (-5.0, -3.0)
        rates[kind] = float(10.0 ** rng.uniform(low, high))
    return FaultSpec(**rates)


@dataclass(frozen=True)
class Event:
    """Something that happens between two bytes: `delay`, `drop`, `reset` or `stall`, the first and last for a time."""

    kind: Kind
    duration_s: float = 0.0


class FaultyLine:
    """One direction of a line; what goes in comes out damaged."""

    def __init__(self, spec: FaultSpec, rng: np.random.Generator) -> None:
        self._rates = {kind: getattr(spec, kind) for kind in KINDS if getattr(spec, kind) > 0.0}
        self._rng = rng
        self._at = 0
        self._next = {kind: int(rng.geometric(rate)) for kind, rate in self._rates.items()}
        self.struck: dict[str, int] = dict.fromkeys(KINDS, 0)

    def pass_on(self, data: bytes) -> list[bytes | Event]:
        """Return what comes out for `data`: bytes and events in their order."""
        out: list[bytes | Event] = []
        piece, done, end = bytearray(), 0, self._at + len(data)
        while self._next and (kind := min(self._next, key=self._next.__getitem__)) and self._next[kind] < end:
            i = self._next[kind] - self._at
            piece += data[done:i]
            done = max(done, i)
            self._next[kind] += int(self._rng.geometric(self._rates[kind]))
            self.struck[kind] += 1
            if kind in ("delay", "drop", "reset", "stall"):
                longest_s = {"delay": 1.0, "stall": 4.0}.get(kind, 0.0)
                out += [bytes(piece), Event(kind, float(self._rng.uniform(0.0, longest_s)))]
                piece = bytearray()
            else:
                done = self._damage(kind, data, done, piece)
        piece += data[done:]
        self._at = end
        return [*out, bytes(piece)]

    def _damage(self, kind: Kind, data: bytes, i: int, piece: bytearray) -> int:
        """Append to `piece` what comes of the byte `i`; return the next byte to pass on unharmed."""
        if kind == "garbage":
            piece += self._rng.bytes(int(self._rng.integers(1, 41)))
        elif kind == "lose":
            return min(i + int(self._rng.integers(1, 21)), len(data))
        elif kind == "repeat":
            piece += data[i : i + int(self._rng.integers(1, 21))]
        elif i < len(data):
            piece.append(data[i] ^ (1 << int(self._rng.integers(8))))
            return i + 1
        return i
