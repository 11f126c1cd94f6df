"""Archives of control systems: one line per reading (time, name, value), each name on a clock of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.precision import Precision
from campaigns.facts.resampled import fact as resampled_fact
from campaigns.facts.resampled import resampling
from campaigns.importing.clock import Clock, Stamps, clock_start, resampled
from campaigns.importing.gathering import Files, Part, stamps_of
from campaigns.importing.mapping import ChannelMap, ImportMap, PartMap
from campaigns.importing.record import Layout, to_si, unwrapped
from campaigns.importing.text import TextSource
from campaigns.log import Unit
from campaigns.progress import Report
from sim_backend.errors import ConfigError, DataError

Array = NDArray[np.float64]

MOST_ROWS = 50_000_000
"""Rows on one clock that an archive may become: 400 MB a channel."""


def gather_archive(files: Files, part: PartMap | None, units: Mapping[str, Unit], report: Report) -> Part:
    """Return the channels of an archive on one clock, from the last of their first readings to the first of their last.

    Raises DataError for names that are not there and readings that are no numbers, ConfigError for a map without rate
    or method of resampling.
    """
    found, log = files.map, files.map.log
    where = f"part '{part.label}': " if part else ""
    assert log.archive is not None and log.resample is not None and log.sample_rate_hz is not None
    source = files.source(None, part, f"{where}archive")
    if not isinstance(source, TextSource):
        raise ConfigError(f"{source.path} is not a text table: an archive has a line of text per reading")
    named, values = source.coded(log.archive.name), source.numbers(log.archive.value)
    for key, column in (("name", named), ("value", values)):
        if column is None:
            there = ", ".join(source.names())
            raise DataError(
                f"{source.path} has no column '{getattr(log.archive, key)}' for the archive: it has {there}"
            )
    found_stamps, read_as = stamps_of(source, log.archive.time, log.time_unit, f"{where}time '{log.archive.time}'")
    assert named is not None and values is not None
    time_s, (codes, names) = found_stamps.after_s, named
    series = {}
    for i, (channel, wanted) in enumerate(_selected(found, part).items()):
        report(i, len(found.channels), f"reading {where}channel '{channel}'")
        rows = np.flatnonzero(codes == names.index(wanted)) if wanted in names else np.zeros(0, np.intp)
        if rows.size < 2:
            some = ", ".join(names)
            raise DataError(
                f"{source.path} has {rows.size} reading(s) of '{wanted}', two are needed; it has {some[:200]}"
            )
        series[channel] = _one(source, log.archive.value, rows, time_s, values, wanted)
    first, last = max(t[0] for t, _ in series.values()), min(t[-1] for t, _ in series.values())
    count = int((last - first) * log.sample_rate_hz + 1e-6) + 1
    if count > MOST_ROWS:
        raise DataError(f"{where}the archive lasts {last - first:.6g} s, {count} samples: say a lower sample_rate_hz")
    if count < 2:
        raise DataError(f"{where}the channels of the archive have no time in common: select others, or import apart")
    grid = first + np.arange(count) / log.sample_rate_hz
    label, given = (part.label, part.settings) if part else ("", {})
    filled, facts = {}, []
    for channel, (stamps, readings) in series.items():
        settings = found.channels[channel]
        if settings.unwrap is not None:
            readings = unwrapped(readings, settings.unwrap, f"{where}channel '{channel}'")
        drawn, error = resampled(stamps, readings, grid, log.resample)
        filled[channel] = to_si(drawn, settings, units[channel], f"{where}channel '{channel}'")
        facts.append(resampled_fact(channel, label, label, resampling(stamps, grid, log.resample, error)))
    clock = Clock(log.sample_rate_hz, clock_start(Stamps(grid, found_stamps.origin_ns)), read_as)
    kept = {
        name: _precision(source, log.archive.value, found.channels[name], units[name], series[name]) for name in series
    }
    return Part(label, given, filled, Layout(count, 1, 1), clock, tuple(facts), kept)


def _precision(
    source: TextSource, column: str, channel: ChannelMap, unit: Unit, readings: tuple[Array, Array]
) -> Precision | None:
    """Return how finely readings are written, as all of the column are."""
    found = source.precision(column)
    largest = abs(channel.scale * unit.factor) * float(np.abs(readings[1]).max())
    return None if found is None else replace(found, largest=largest)


def _selected(found: ImportMap, part: PartMap | None) -> dict[str, str]:
    chosen = {}
    for name, channel in found.channels.items():
        wanted = (part.select.get(name) if part else None) or channel.select
        for key in ("time", "sample_rate_hz", "source"):
            if getattr(channel, key):
                raise ConfigError(
                    f"[channels.{name}] states {key}, and a channel of an archive has that of the archive: take it out"
                )
        if wanted is None:
            raise ConfigError(f"[channels.{name}] of an archive is selected by the name of its readings: give select")
        chosen[name] = wanted
    return chosen


def _one(
    source: TextSource, column: str, rows: NDArray[np.intp], time_s: Array, values: Array, name: str
) -> tuple[Array, Array]:
    """Return stamps and values of one name, in order of time; of several readings at one time the last counts."""
    bad = rows[np.isnan(values[rows])]
    if bad.size:
        cell = source.cell(column, int(bad[0]))
        raise DataError(
            f"{source.path}: the reading of '{name}' in row {bad[0] + 1} of the data is '{cell[:40]}', which is not a "
            "finite number: repair it or take the line out"
        )
    order = np.argsort(time_s[rows], kind="stable")
    stamps, numbers = time_s[rows][order], values[rows][order]
    last = np.append(np.diff(stamps) > 0.0, True)
    return stamps[last], numbers[last]
