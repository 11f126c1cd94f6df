"""The import: read a map, gather and check everything it names, and only then write the log."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from campaigns.importing.mapping import ImportMap, PartMap, read_map
from campaigns.importing.record import Layout, check_lengths, check_varies, clock_of, flatten, to_si
from campaigns.importing.sources import Source, open_source, select
from campaigns.log import Channel, LogSegment, LogWriter, Unit, sha256_of, unit_named
from campaigns.log.guard import one_line
from campaigns.log.schema import check_label, check_name, to_json
from campaigns.log.write import SETTINGS_BYTES
from campaigns.progress import Report, part_of, unheard
from campaigns.version import tool_commit
from sim_backend.errors import ConfigError, DataError, MccdError

Array = NDArray[np.float64]
# Two parts of one clock: stamps rounded to 1 % of a period fix the rate of 100 samples to 1e-4.
RATE_AGREEMENT = 1e-4
GATHERING = 0.7
"""Share of the time that reading and checking the sources takes; the log is written in the rest."""

MOST_OPEN = 8
"""Some sources are processes, and a map may name thousands of files."""


@dataclass(frozen=True)
class ImportReport:
    """What was written: the log, its run, its rows and rate, its channels in SI and its segments."""

    path: Path
    run_uid: str
    rows: int
    sample_rate_hz: float
    channels: tuple[Channel, ...]
    segments: tuple[LogSegment, ...]


@dataclass(frozen=True)
class _Part:
    label: str
    settings: Mapping[str, Any]
    columns: Mapping[str, Array]
    layout: Layout
    rate_hz: float
    t0_s: float


@dataclass(frozen=True)
class _Files:
    """The sources of one import, the last few of them open; `used` names them all."""

    folder: Path
    map: ImportMap
    closing: ExitStack
    opened: dict[str, Source] = field(default_factory=dict)
    used: dict[str, Path] = field(default_factory=dict)

    def source(self, wanted: str | None, part: PartMap | None, what: str) -> Source:
        """Return the file that `wanted` names or is, by default the part's, by default the log's."""
        given = wanted or (part.source if part else None) or self.map.log.source
        if given is None:
            raise ConfigError(f"{what} has no source: name one there, in its part or in [log]")
        named = self.map.sources | (part.sources if part else {})
        name = named.get(given, given)
        if name not in self.opened:
            if len(self.opened) == MOST_OPEN:
                self.closing.close()
                self.opened.clear()
            log, self.used[name] = self.map.log, self.folder / name
            self.opened[name] = open_source(self.folder / name, self.closing, log.delimiter, log.decimal)
        return self.opened[name]


def import_run(
    map_path: str | os.PathLike[str], target: str | os.PathLike[str], report: Report = unheard
) -> ImportReport:
    """Import what the map at `map_path` names into a new log at `target`; sources count from the map's folder.

    All data are held in memory once. Raises ConfigError for the map and an existing target, DataError for the
    sources; in both cases nothing is written.
    """
    path = Path(map_path)
    found, text = read_map(path)
    if Path(target).exists():
        raise ConfigError(f"{target} exists and a log never overwrites: choose another path with --out")
    try:
        units = {name: _unit(name, channel.unit) for name, channel in found.channels.items()}
        wanted: Sequence[PartMap | None] = found.parts or (None,)
        with ExitStack() as closing:
            files = _Files(path.parent, found, closing)
            shares = np.linspace(0.0, GATHERING, len(wanted) + 1)
            parts = [
                _gather(files, part, units, part_of(report, start, stop))
                for part, start, stop in zip(wanted, shares[:-1], shares[1:], strict=True)
            ]
        for name, channel in found.channels.items():
            check_varies([part.columns[name] for part in parts], name, channel)
        rate_hz = _common_rate(parts)
        segments = _segments(found, parts)
        _check_labels(segments)
        channels = [
            Channel(name, units[name].si, channel.role, channel.dof, rate_hz, parts[0].t0_s)
            for name, channel in found.channels.items()
        ]
    except MccdError as error:
        raise type(error)(one_line(f"{path}: {error}")) from None
    told = part_of(report, GATHERING, 1.0)
    run_uid = _write(Path(target), found, _configuration(text, files), channels, parts, segments, told)
    rows = sum(part.layout.rows for part in parts)
    return ImportReport(Path(target), run_uid, rows, rate_hz, tuple(channels), tuple(segments))


def _unit(name: str, symbol: str) -> Unit:
    check_name(name, "channel")
    try:
        return unit_named(symbol)
    except ConfigError as error:
        raise ConfigError(f"[channels.{name}]: {error}") from None


def _gather(files: _Files, part: PartMap | None, units: Mapping[str, Unit], report: Report) -> _Part:
    where = f"part '{part.label}': " if part else ""
    log = files.map.log
    columns: dict[str, Array] = {}
    layouts: dict[str, Layout] = {}
    for i, (name, channel) in enumerate(files.map.channels.items()):
        what = f"{where}channel '{name}'"
        report(i, len(files.map.channels), f"reading {what}")
        values = select(files.source(channel.source, part, what), channel.select)
        rows, layouts[name] = flatten(values, log.axes, what)
        columns[name] = to_si(rows, channel, units[name], what)
    layout = check_lengths(layouts, where)
    _check_period(files.map, layout, where)
    rate_hz, t0_s = log.sample_rate_hz, 0.0
    if log.time is not None:
        what = f"{where}time '{log.time}'"
        stamps, clock = flatten(select(files.source(None, part, what), log.time), ("sample",), what)
        if clock.rows not in (layout.samples, layout.rows):
            raise DataError(f"{what} has {clock.rows} stamps for {layout.rows} samples: select equal lengths")
        rate_hz, t0_s = clock_of(stamps, what)
    assert rate_hz is not None  # the map was checked to hold a rate or a time
    label, settings = (part.label, part.settings) if part else ("", {})
    return _Part(label, settings, columns, layout, rate_hz, t0_s)


def _check_period(found: ImportMap, layout: Layout, where: str) -> None:
    period = found.log.period
    if period is None:
        return
    if "period" in found.log.axes and period != layout.samples:
        raise DataError(
            f"{where}period is {period} in [log] but the axis 'sample' has {layout.samples}: make them equal"
        )
    if period > layout.samples:
        raise DataError(f"{where}period is {period} samples of only {layout.samples}: correct it in [log]")


def _common_rate(parts: list[_Part]) -> float:
    first = parts[0].rate_hz
    for part in parts[1:]:
        if abs(part.rate_hz / first - 1.0) > RATE_AGREEMENT:
            raise DataError(
                f"part '{part.label}' runs at {part.rate_hz:.9g} Hz, the first at {first:.9g} Hz: "
                "a log has one rate, import them apart"
            )
    return first


def _segments(found: ImportMap, parts: list[_Part]) -> list[LogSegment]:
    period = {} if found.log.period is None else {"period_samples": found.log.period}
    if found.segments:
        return _explicit(found, parts[0].layout.rows, period)
    segments: list[LogSegment] = []
    start = 0
    for part in parts:
        layout = part.layout
        if "period" in found.log.axes:
            period = {"period_samples": layout.samples, "periods": layout.periods}
        length = layout.samples * layout.periods
        for index in range(layout.realisations):
            many = "realisation" in found.log.axes
            words = [part.label, f"realisation {index}" if many else ""]
            label = " ".join(word for word in words if word) or "record"
            settings = dict(part.settings) | period | ({"realisation": index} if many else {})
            segments.append(LogSegment(label, start, start + length, settings))
            start += length
    return segments


def _check_labels(segments: list[LogSegment]) -> None:
    labels = [segment.label for segment in segments]
    for label in labels:
        check_label(label)
        if labels.count(label) > 1:
            raise ConfigError(
                f"segment '{label}' appears {labels.count(label)} times: give each part a label of its own"
            )


def _explicit(found: ImportMap, rows: int, period: Mapping[str, int]) -> list[LogSegment]:
    segments = [LogSegment(label, *span, period) for label, span in found.segments.items()]
    segments.sort(key=lambda segment: segment.start)
    free = 0
    for segment in segments:
        if not segment.start < segment.stop <= rows:
            raise ConfigError(
                f"segment '{segment.label}' is [{segment.start}, {segment.stop}] of {rows} samples: "
                "start must be below stop, and stop at most the number of samples"
            )
        if segment.start < free:
            raise ConfigError(f"segment '{segment.label}' starts at {segment.start} before another ends at {free}")
        free = segment.stop
    return segments


def _configuration(text: str, files: _Files) -> str:
    sources = [{"file": name, "sha256": sha256_of(path)} for name, path in sorted(files.used.items())]
    return json.dumps({"map": text, "sources": sources}, ensure_ascii=False)


def _write(
    target: Path,
    found: ImportMap,
    configuration: str,
    channels: list[Channel],
    parts: list[_Part],
    segments: list[LogSegment],
    report: Report,
) -> str:
    columns = {
        channel.name: np.concatenate([part.columns[channel.name] for part in parts])
        if len(parts) > 1
        else parts[0].columns[channel.name]
        for channel in channels
    }
    widest = max((len(to_json(segment.settings, segment.label).encode()) for segment in segments), default=0)
    with LogWriter.create(
        target,
        channels,
        test=found.log.test,
        bench={"kind": "imported", "name": found.log.bench[:256]},
        configuration=configuration,
        started_utc=found.log.started_utc,
        tool_commit=tool_commit(),
        settings_bytes=max(widest, SETTINGS_BYTES),
    ) as log:
        done = 0
        for segment in segments:
            report(done, segments[-1].stop, f"writing {target.name}")
            log.append({name: column[done : segment.start] for name, column in columns.items()})
            with log.segment(segment.label, segment.settings):
                log.append({name: column[segment.start : segment.stop] for name, column in columns.items()})
            done = segment.stop
        log.append({name: column[done:] for name, column in columns.items()})
        return log.run_uid
