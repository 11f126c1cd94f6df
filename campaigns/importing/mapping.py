"""The map of an import: which variable of which file is which channel, read from TOML and checked at once."""

from __future__ import annotations

import difflib
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct, field

from campaigns.importing.clock import Method, TimeUnit
from campaigns.log.guard import one_line
from campaigns.log.schema import check_time
from sim_backend.documents import read_text, toml_of
from sim_backend.errors import ConfigError

Axis = Literal["sample", "realisation", "period"]
Positive = Annotated[float, Meta(gt=0.0, le=1e9)]
Count = Annotated[int, Meta(ge=2, le=2**40)]
Row = Annotated[int, Meta(ge=0, le=2**48)]
Text = Annotated[str, Meta(min_length=1, max_length=1000)]
Factor = Annotated[float, Meta(ge=-1e30, le=1e30)]
_UNKNOWN_FIELD = re.compile(r"unknown field `(?P<field>.*?)`(?: - at `\$(?P<place>.*)`)?")


class ArchiveMap(Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[log.archive]`: the columns of a text table that has one line per reading."""

    time: Text
    name: Text
    value: Text


class LogMap(Struct, frozen=True, forbid_unknown_fields=True):
    """The table `[log]`: the test, the default source, the clock and the layout of the arrays."""

    test: Text
    source: Text | None = None
    sample_rate_hz: Positive | None = None
    time: Text | None = None
    time_unit: TimeUnit | None = None
    resample: Method | None = None
    archive: ArchiveMap | None = None
    period: Count | None = None
    axes: tuple[Axis, ...] = ("sample",)
    bench: Text = "imported"
    started_utc: Text | None = None
    delimiter: Annotated[str, Meta(min_length=1, max_length=1)] | None = None
    decimal: Literal[".", ","] | None = None
    header: bool | None = None


class ChannelMap(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table `[channels.NAME]`: what to select, its unit in the source, and what it is in the experiment.

    It has either `select` or `combine`, the sum of several selections with their factors. A channel with a clock of its
    own has `time` or `sample_rate_hz`.
    """

    select: Text | None = None
    unit: Text
    role: Literal["input", "output", "reference", "aux"]
    combine: dict[Text, Factor] = field(default_factory=dict)
    dof: str = ""
    scale: Factor = 1.0
    unwrap: Positive | None = None
    source: Text | None = None
    time: Text | None = None
    sample_rate_hz: Positive | None = None
    allow_constant: bool = False
    ignore_file_unit: bool = False

    @property
    def selections(self) -> dict[str, float]:
        """What is selected, each with its factor."""
        return {self.select: 1.0} if self.select is not None else self.combine


class PartMap(Struct, frozen=True, forbid_unknown_fields=True):
    """A table `[[parts]]`: a stretch of the record with sources of its own; parts follow one another in the log.

    `select` says by channel what to select in this part instead of what the channel says.
    """

    label: Text
    source: Text | None = None
    select: dict[str, Text] = field(default_factory=dict)
    sources: dict[str, Text] = field(default_factory=dict)
    settings: dict[str, bool | int | float | str] = field(default_factory=dict)


class ImportMap(Struct, frozen=True, forbid_unknown_fields=True):
    """A whole map; `sources` gives names to files, `segments` cuts a record without parts."""

    log: LogMap
    channels: dict[str, ChannelMap]
    segments: dict[str, tuple[Row, Row]] = field(default_factory=dict)
    sources: dict[str, Text] = field(default_factory=dict)
    parts: list[PartMap] = field(default_factory=list)


def read_map(path: Path) -> tuple[ImportMap, str]:
    """Return the map at `path` and its text; raises ConfigError naming the key, the value and the nearest field."""
    text = read_text(path, "import map", fix="give the path of one")
    try:
        found = msgspec.convert(toml_of(text, str(path)), ImportMap, strict=True)
    except msgspec.ValidationError as error:
        raise ConfigError(one_line(f"{path}: {_explain(error)}")) from None
    _check(found, path)
    return found, text


def _explain(error: msgspec.ValidationError) -> str:
    found = _UNKNOWN_FIELD.search(str(error))
    if not found:
        return str(error).replace("`$.", "`").replace("Object ", "the map ") + "; see docs/importing.md"
    place = found["place"] or ""
    known = _fields_at(place)
    near = difflib.get_close_matches(found["field"], known, n=1)
    hint = f"did you mean '{near[0]}'? " if near else ""
    where = f"[{place.lstrip('.').replace('[...]', '.NAME')}]" if place else "the top level"
    return f"unknown field '{found['field']}' in {where}: {hint}known are {', '.join(known)}"


def _fields_at(place: str) -> tuple[str, ...]:
    structs: dict[str, Any] = {".log.archive": ArchiveMap, ".log": LogMap, ".channels": ChannelMap, ".parts": PartMap}
    for start, struct in structs.items():
        if place.startswith(start):
            return tuple(struct.__struct_fields__)
    return tuple(ImportMap.__struct_fields__)


def _check(found: ImportMap, path: Path) -> None:
    log = found.log
    if not found.channels:
        raise ConfigError(f"{path} names no channel: add a table [channels.NAME]")
    if (log.sample_rate_hz is None) == (log.time is None):
        raise ConfigError(f"{path} needs either sample_rate_hz or time in [log]: give exactly one of them")
    if log.archive is not None and (log.resample is None or log.sample_rate_hz is None or log.axes != ("sample",)):
        raise ConfigError(
            f"{path}: an archive has readings on clocks of their own: say sample_rate_hz and resample in [log], no axes"
        )
    if log.time_unit is not None and log.time is None and log.archive is None:
        raise ConfigError(f"{path} has time_unit in [log] but no time: select the stamps with time, or take it out")
    if log.started_utc is not None:
        check_time(log.started_utc, f"{path}: started_utc")
    if len(set(log.axes)) != len(log.axes) or "sample" not in log.axes:
        raise ConfigError(f"{path} has axes {list(log.axes)}: name 'sample' and each other axis once")
    if found.segments and (found.parts or "realisation" in log.axes):
        raise ConfigError(
            f"{path} has [segments] beside parts or realisations, which are segments already: remove one of them"
        )
    for name, channel in found.channels.items():
        _check_channel(name, channel, log, path)
        if channel.scale == 0.0:
            raise ConfigError(f"{path}: [channels.{name}] has scale 0.0, which makes it constant: give another factor")
    for part in found.parts:
        for name in part.select:
            if name not in found.channels:
                raise ConfigError(
                    f"{path}: part '{part.label}' selects '{name}', which is not a channel: channels are "
                    f"{', '.join(found.channels)}"
                )


def _check_channel(name: str, channel: ChannelMap, log: LogMap, path: Path) -> None:
    if (channel.select is None) == (not channel.combine):
        raise ConfigError(f"{path}: [channels.{name}] needs either select or combine: give exactly one of them")
    if channel.time is not None and channel.sample_rate_hz is not None:
        raise ConfigError(f"{path}: [channels.{name}] has time and sample_rate_hz: give one of them")
    if (channel.time or channel.sample_rate_hz) and log.resample is None:
        raise ConfigError(
            f"{path}: [channels.{name}] has a clock of its own: say in [log] how it is brought to that of the log, "
            'resample = "linear", "cubic" or "hold"'
        )
