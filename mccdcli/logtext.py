"""The channels and segments of a log as text; one form for every command that shows them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from mccdcli.output import table

if TYPE_CHECKING:
    from campaigns.log import Channel, LogSegment


def length_text(rows: int, sample_rate_hz: float) -> str:
    """Return the length of a record of `rows` samples, in samples and in seconds."""
    return f"{rows} samples at {sample_rate_hz:g} Hz, {rows / sample_rate_hz:g} s"


def channels_text(channels: Iterable[Channel]) -> str:
    """Return a table of name, unit, role and degree of freedom."""
    return table([(c.name, c.unit, c.role, c.dof) for c in channels], heads=("channel", "unit", "role", "dof"))


def segments_text(segments: Iterable[LogSegment]) -> str:
    """Return a table of label, first sample and the sample after the last."""
    return table([(s.label, str(s.start), str(s.stop)) for s in segments], heads=("segment", "start", "stop"))
