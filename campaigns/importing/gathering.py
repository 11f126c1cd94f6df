"""One part of a record, read from its sources: every channel in SI on one clock, and what was noticed on the way."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from campaigns.facts import Fact
from campaigns.facts.precision import Precision, coarsest
from campaigns.facts.resampled import Resampling, resampling
from campaigns.facts.resampled import fact as resampled_fact
from campaigns.importing.cells import read_number
from campaigns.importing.clock import (
    LATEST_S,
    SECONDS,
    Clock,
    Stamps,
    ascending,
    clock_of,
    dates,
    grid_of,
    resampled,
    stamps_in,
    unit_in,
)
from campaigns.importing.isolated import IsolatedSource
from campaigns.importing.mapping import ChannelMap, ImportMap, LogMap, PartMap
from campaigns.importing.record import Layout, check_lengths, flatten, to_si, unwrapped
from campaigns.importing.sources import Source, column_named, open_source, select, variable_of
from campaigns.importing.text import CellError, TextSource
from campaigns.log import Unit
from campaigns.log.guard import most_bytes, stored_bytes
from campaigns.log.units import is_unit, unit_named
from campaigns.progress import Report
from sim_backend.errors import ConfigError, DataError

Array = NDArray[np.float64]

MOST_OPEN = 8
"""Some sources are processes, and a map may name thousands of files."""


@dataclass(frozen=True)
class Part:
    """A part of the record: its `columns` (n,) in SI by channel, and the axes (`layout`) they had in the source.

    `facts` tell of resampling, `precisions` with how many digits or bits the source keeps each channel.
    """

    label: str
    settings: Mapping[str, Any]
    columns: Mapping[str, Array]
    layout: Layout
    clock: Clock
    facts: tuple[Fact, ...]
    precisions: Mapping[str, Precision | None]


@dataclass(frozen=True)
class Files:
    """The sources of one import, the last few of them open; `used` names them all.

    They lie in the map's `folder` or below, links resolved, unless the user lets a map read elsewhere (`outside`).
    """

    folder: Path
    map: ImportMap
    closing: ExitStack
    outside: bool = False
    opened: dict[str, Source] = field(default_factory=dict)
    used: dict[str, Path] = field(default_factory=dict)
    taken: list[int] = field(default_factory=list)

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
            log, self.used[name] = self.map.log, self._path(name)
            known = (log.archive.time, log.archive.name, log.archive.value) if log.archive else ()
            self.opened[name] = open_source(
                self.used[name], self.closing, log.delimiter, log.decimal, log.header, known
            )
        return self.opened[name]

    def take(self, size: int, what: str) -> None:
        """Count `size` more bytes that a channel takes; raises DataError where it is too much in all.

        Each array may unpack to much: forty of them, or one that forty channels select, would fill the memory.
        """
        self.taken.append(size)
        stored = {path: stored_bytes(path) for path in self.used.values()}
        limit = sum(most_bytes(count) for count in stored.values())
        if (total := sum(self.taken)) > limit:
            told = f"channels of {total} bytes together, of at most {limit} for sources of {sum(stored.values())}"
            raise DataError(f"{what}: the map selects {told}: store them with less compression, or select fewer")

    def _path(self, name: str) -> Path:
        """Return the path of a source; raises ConfigError, before anything is read, for one that lies elsewhere."""
        path, folder = self.folder / name, self.folder.resolve()
        if self.outside or path.resolve().is_relative_to(folder):
            return path
        raise ConfigError(
            f"source '{name}' is {path.resolve()}, outside the folder of the map, {folder}: move the data there, "
            "or let this map read elsewhere with --allow-outside"
        )


def gather(files: Files, part: PartMap | None, units: Mapping[str, Unit], report: Report) -> Part:
    """Return a part of the record, all of it where there are no parts.

    Raises DataError for sources that do not hold what the map says, ConfigError for a map that fits none.
    """
    where = f"part '{part.label}': " if part else ""
    log, channels = files.map.log, files.map.channels
    columns: dict[str, Array] = {}
    layouts: dict[str, Layout] = {}
    onto: dict[str, Resampling] = {}
    precisions: dict[str, Precision | None] = {}
    for i, (name, channel) in enumerate(channels.items()):
        what = f"{where}channel '{name}'"
        report(i, len(channels), f"reading {what}")
        try:
            columns[name], layouts[name], precisions[name] = _column(files, part, name, channel, units[name], what)
        except CellError as error:
            raise DataError(f"{what}: {error}") from None
    apart = {name for name, channel in channels.items() if channel.time or channel.sample_rate_hz}
    if apart == set(channels):
        raise ConfigError(f"{where}every channel has a clock of its own: let one have that of the log")
    layout = check_lengths({n: found for n, found in layouts.items() if n not in apart}, where)
    _check_period(files.map, layout, where)
    stamps = Stamps(np.zeros(0))
    if log.time is None:
        assert log.sample_rate_hz is not None  # the map was checked to hold a rate or a time
        clock = Clock(log.sample_rate_hz, 0.0, "")
    else:
        what = f"{where}time '{log.time}'"
        stamps, read_as = stamps_of(files.source(None, part, what), log.time, log.time_unit, what)
        if stamps.after_s.size not in (layout.samples, layout.rows):
            raise DataError(f"{what} has {stamps.after_s.size} stamps for {layout.rows} samples: select equal lengths")
        if log.resample is None:
            clock = clock_of(stamps, what, read_as)
        else:
            clock, grid = grid_of(stamps, what, read_as)
            ours = {name: column for name, column in columns.items() if name not in apart}
            layout = _on_grid(log, stamps.after_s, grid, ours, columns, layout, what, onto)
    first_s = float(stamps.after_s[0]) if stamps.after_s.size else 0.0
    rows = Stamps(first_s + np.arange(layout.rows) / clock.rate_hz, stamps.origin_ns)
    for name in sorted(apart):
        what = f"{where}channel '{name}'"
        onto[name] = _join(files, part, channels[name], name, rows, columns, what)
    label, settings = (part.label, part.settings) if part else ("", {})
    segment = "" if "realisation" in log.axes else label
    facts = tuple(resampled_fact(name, label, segment, onto[name]) for name in channels if name in onto)
    return Part(label, settings, columns, layout, clock, facts, precisions)


def _column(
    files: Files, part: PartMap | None, name: str, channel: ChannelMap, unit: Unit, what: str
) -> tuple[Array, Layout, Precision | None]:
    source = files.source(channel.source, part, what)
    given = {part.select[name]: 1.0} if part and name in part.select else channel.selections
    summed: Array | None = None
    precisions: list[Precision | None] = []
    for selection, factor in given.items():
        found = select(source, selection)
        if summed is None:
            files.take(8 * found.size, what)  # before it is copied
        values, layout = flatten(found, files.map.log.axes, what)
        _check_unit(source, variable_of(source, selection), channel, what)
        if channel.unwrap is not None:
            values = unwrapped(values, channel.unwrap, what)
        values = values if factor == 1.0 else factor * values
        precisions.append(_precision_of(source, selection, values, channel.scale * unit.factor))
        if summed is not None and summed.size != values.size:
            raise DataError(f"{what} combines {summed.size} and {values.size} samples: select equal lengths")
        summed = values if summed is None else summed + values
    assert summed is not None  # the map was checked to select something
    chosen = ", ".join(f"'{selection}'" for selection in given)
    si = to_si(summed, channel, unit, f"{what} ({chosen} of {source.path})")
    return si, layout, coarsest(precisions)


def _precision_of(source: Source, selection: str, values: Array, factor: float) -> Precision | None:
    """Return how finely a selection is kept, whose values (n,) are in SI when multiplied by `factor`."""
    if isinstance(source, TextSource):
        found = source.precision(column_named(source, selection))
    else:
        found = source.precision(variable_of(source, selection))
    return None if found is None else replace(found, largest=abs(factor) * float(np.abs(values).max()))


def _check_unit(source: Source, selection: str, channel: ChannelMap, what: str) -> None:
    """Raise DataError where the file itself names another unit than the map."""
    told = source.unit(selection)
    if told is None or channel.ignore_file_unit or not is_unit(told):
        return
    theirs, ours = unit_named(told), unit_named(channel.unit)
    if (theirs.si, theirs.factor, theirs.offset) != (ours.si, ours.factor, ours.offset):
        raise DataError(
            f"{what}: {source.path} says that '{selection}' is in {told}, the map says {channel.unit}: correct the "
            "map, or say ignore_file_unit = true in the channel if the file is wrong"
        )


def stamps_of(source: Source, selected: str, unit: str | None, what: str) -> tuple[Stamps, str]:
    """Return the time stamps that a selection holds, and how they were read.

    Raises DataError where a unit is stated that is none of time, and where numbers stand for no time in seconds and
    nothing says another unit.
    """
    name = selected
    if isinstance(source, TextSource):
        name = column_named(source, selected)
        first = source.first_cell(name) if unit in (None, "date") else None
        if first is not None and (unit == "date" or are_dates(first)):
            return dates(source.cells(name) or [], what), "dates"
    values = select(source, selected)
    own = variable_of(source, selected)
    if isinstance(source, IsolatedSource) and source.dated(own):
        unit = "ns"
    rows, _ = flatten(values, ("sample",), what)
    if unit == "date":
        raise ConfigError(f"{what} holds no dates but numbers: say the unit that they have")
    stated = source.unit(own) or ""
    told = unit or unit_in(stated) or unit_in(own)
    if told is None and stated:
        raise DataError(
            f"{what}: {source.path} says that its unit is '{stated[:40]}', which is none of time: say time_unit "
            f"({', '.join(SECONDS)} or date) in [log]"
        )
    found = stamps_in(values.reshape(-1) if values.dtype.kind in "iu" else rows, told or "s")
    if told is None and found.after_s.size and abs(found.first_s) > LATEST_S:
        raise DataError(
            f"{what} begins at {found.first_s:.6g} s, later than any clock of seconds: say time_unit "
            f"({', '.join(SECONDS)} or date) in [log]"
        )
    return found, f"'{selected}' in {told}" if told else f"'{selected}' in s, as nothing says another unit"


def are_dates(cell: str) -> bool:
    """Tell whether a cell is a date or a time of day."""
    return read_number(cell, ".") is None and bool(re.match(r"\d{1,4}[-/.:]\d{1,2}[-/.:]\d", cell))


def _on_grid(
    log: LogMap,
    stamps: Array,
    grid: Array,
    ours: Mapping[str, Array],
    columns: dict[str, Array],
    layout: Layout,
    what: str,
    onto: dict[str, Resampling],
) -> Layout:
    """Put the columns on the uniform grid and return their layout; adds how each was resampled."""
    assert log.resample is not None
    if layout.rows != stamps.size or layout.samples != layout.rows:
        raise ConfigError(f"{what}: resample takes one stamp per sample; import realisations and periods as parts")
    for name, column in ours.items():
        columns[name], error = resampled(stamps, column, grid, log.resample)
        onto[name] = resampling(stamps, grid, log.resample, error)
    return Layout(grid.size, 1, 1)


def _join(
    files: Files,
    part: PartMap | None,
    channel: ChannelMap,
    name: str,
    rows: Stamps,
    columns: dict[str, Array],
    what: str,
) -> Resampling:
    """Bring a channel with a clock of its own to the samples of the log and return how."""
    log, own = files.map.log, columns[name]
    assert log.resample is not None  # the map was checked to say it
    if channel.time is not None:
        stamps, _ = stamps_of(files.source(channel.source, part, what), channel.time, log.time_unit, what)
        time_s = stamps.since(rows)
    else:
        assert channel.sample_rate_hz is not None
        time_s = rows.after_s[0] + np.arange(own.size) / channel.sample_rate_hz
    if time_s.size != own.size:
        raise DataError(f"{what} has {time_s.size} stamps for {own.size} samples: select equal lengths")
    ascending(time_s, f"the clock of {what}")
    slack, wanted = float(np.median(np.diff(time_s))), rows.after_s
    if time_s[0] > wanted[0] + slack or time_s[-1] < wanted[-1] - slack:
        raise DataError(
            f"{what} lasts from {time_s[0]:.6g} to {time_s[-1]:.6g} s, the log from {wanted[0]:.6g} to "
            f"{wanted[-1]:.6g} s on the same clock: select the stretch that all channels have"
        )
    columns[name], error = resampled(time_s, own, wanted, log.resample)
    return resampling(time_s, wanted, log.resample, error)


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
