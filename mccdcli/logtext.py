"""The channels and segments of a log as text; one format for every command that shows them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from mccdcli.output import table

if TYPE_CHECKING:
    from campaigns.log import Channel, LogSegment


SIZES: Final = ("smallest", "largest", "rms")
NO_SIZES: Final[Mapping[str, Mapping[str, float]]] = MappingProxyType({})


def length_text(rows: int, sample_rate_hz: float) -> str:
    """Return the length of a record of `rows` samples, in samples and in seconds."""
    return f"{rows} samples at {sample_rate_hz:g} Hz, {rows / sample_rate_hz:g} s"


def channels_text(channels: Iterable[Channel], sizes: Mapping[str, Mapping[str, float]] = NO_SIZES) -> str:
    """Return a table of name, unit, role and degree of freedom, with the sizes that are known of some."""
    rows = [(c.name, c.unit, c.role, c.dof) for c in channels]
    heads: tuple[str, ...] = ("channel", "unit", "role", "dof")
    if not sizes:
        return table(rows, heads=heads)
    known = [[f"{sizes[row[0]][key]:.6g}" if key in sizes.get(row[0], ()) else "" for key in SIZES] for row in rows]
    return table([(*row, *more) for row, more in zip(rows, known, strict=True)], heads=(*heads, *SIZES))


def segments_text(segments: Iterable[LogSegment]) -> str:
    """Return a table of label, first sample and the sample after the last."""
    return table([(s.label, str(s.start), str(s.stop)) for s in segments], heads=("segment", "start", "stop"))
