"""The channels and segments of a log as text; one format for every command that shows them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from mccdcli.output import table

if TYPE_CHECKING:
    from campaigns.facts.size import Size
    from campaigns.log import Channel, LogSegment

SIZES: Final = {"smallest": "smallest", "largest": "largest", "rms": "rms about the mean"}
NO_SIZES: Final[Mapping[str, Size]] = MappingProxyType({})


def length_text(rows: int, sample_rate_hz: float) -> str:
    """Return the length of a record of `rows` samples, in samples and in seconds."""
    return f"{rows} samples at {sample_rate_hz:g} Hz, {rows / sample_rate_hz:g} s"


def channels_text(channels: Iterable[Channel], sizes: Mapping[str, Size] = NO_SIZES) -> str:
    """Return a table of name, unit, role and degree of freedom, with the sizes that are known of some."""
    rows = [(c.name, c.unit, c.role, c.dof) for c in channels]
    heads: tuple[str, ...] = ("channel", "unit", "role", "dof")
    if not sizes:
        return table(rows, heads=heads)
    from analysis.pages.formats import readable

    known = [[readable(getattr(sizes[row[0]], key), 6) if row[0] in sizes else "" for key in SIZES] for row in rows]
    return table([(*row, *more) for row, more in zip(rows, known, strict=True)], heads=(*heads, *SIZES.values()))


def segments_text(segments: Iterable[LogSegment]) -> str:
    """Return a table of label, first sample and the sample after the last."""
    return table([(s.label, str(s.start), str(s.stop)) for s in segments], heads=("segment", "start", "stop"))
