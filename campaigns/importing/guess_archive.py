"""Recognises a table with one line per reading, and proposes how a map takes it apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.importing.cells import read_number
from campaigns.importing.clock import unit_in
from campaigns.importing.gathering import are_dates, stamps_of
from campaigns.importing.guess_names import TIME, VALUE
from campaigns.importing.text import TextSource
from sim_backend.errors import DataError

Array = NDArray[np.float64]

READINGS = 4
"""Least readings per name on average: texts that differ more than that are no names."""

LASTING = 0.5
"""Least share of the record that the readings of a channel span: channels need time in common."""


@dataclass(frozen=True)
class Archive:
    """Readings (n,) by their names, the lines of the map on the clock, what was found, and what is left out."""

    series: Mapping[str, Array]
    lines: str
    said: str
    left: tuple[str, ...]


def archive_in(source: TextSource) -> Archive | None:
    """Return what a table holds as an archive; None where it has a sample per line, or columns that fit neither.

    Raises DataError for a file that cannot be read.
    """
    names = [name for name in source.names() if name and source.names().count(name) == 1]
    time = next((name for name in names if _is_time(source, name)), None)
    if time is None or len(names) < 3:
        return None
    try:
        stamps, _ = stamps_of(source, time, None, f"time '{time}'")
    except DataError:
        return None
    texts = _names_in(source, [name for name in names if name != time])
    if texts is None:
        return None
    named, codes, known = texts
    values = {name: source.numbers(name) for name in names if name not in (time, named)}
    numbers = {name: found for name, found in values.items() if found is not None and np.isfinite(found).mean() > 0.5}
    if not numbers or (len(numbers) > 1 and bool(np.all(np.diff(stamps.after_s) > 0.0))):
        return None  # a sample per line, with a remark
    value = next((name for name in numbers if VALUE.search(name)), None)
    value = value or max(numbers, key=lambda name: np.unique(numbers[name]).size)
    return _proposed(source, (time, named, value), stamps.after_s, codes, known, numbers[value])


def _is_time(source: TextSource, name: str) -> bool:
    first = source.first_cell(name) or ""
    return are_dates(first) or (
        TIME.search(name) is not None and read_number(first, source.dialect.decimal) is not None
    )


def _names_in(source: TextSource, among: list[str]) -> tuple[str, NDArray[np.int32], list[str]] | None:
    """Return the one column of texts of which each stands in several lines, None where there is not exactly one."""
    found = []
    for name in among:
        try:
            coded = source.coded(name)
        except DataError:
            continue  # more texts than names
        if coded is None:
            continue
        codes, texts = coded
        words = [text for text in texts if text and read_number(text, source.dialect.decimal) is None]
        if len(words) == len(texts) >= 2 and codes.size >= READINGS * len(texts):
            found.append((name, codes, texts))
    return found[0] if len(found) == 1 else None


def _proposed(
    source: TextSource,
    columns: tuple[str, str, str],
    time_s: Array,
    codes: NDArray[np.int32],
    names: list[str],
    values: Array,
) -> Archive | None:
    time, named, value = columns
    series: dict[str, Array] = {}
    rates_hz: dict[str, float] = {}
    left = []
    for code, name in enumerate(names):
        rows = np.flatnonzero(codes == code)
        stamps, readings = np.unique(time_s[rows]), values[rows]
        if stamps.size < 2 or not np.all(np.isfinite(readings)):
            left.append(f"'{name}' is left out: its readings are not all numbers, or it has only one")
        elif np.ptp(stamps) < LASTING * np.ptp(time_s):
            left.append(f"'{name}' is left out: it lasts {np.ptp(stamps):.6g} s of {np.ptp(time_s):.6g} s")
        else:
            series[name], rates_hz[name] = readings, 1.0 / float(np.median(np.diff(stamps)))
    if len(series) < 2:
        return None
    fastest = max(rates_hz, key=lambda name: rates_hz[name])
    dated = are_dates(source.first_cell(time) or "")
    unit = "date" if dated else unit_in(source.unit(time) or "") or unit_in(time)
    doubt = "" if unit else "   # DOUBTFUL: nothing says the unit of time"
    lines = [
        f"archive = {{ time = {_text(time)}, name = {_text(named)}, value = {_text(value)} }}",
        f'time_unit = "{unit or "s"}"{doubt}',
        f"sample_rate_hz = {rates_hz[fastest]:.6g}   # DOUBTFUL: that of the fastest, {_text(fastest)}",
        'resample = "linear"   # DOUBTFUL: or "cubic", or "hold" for what keeps its value until the next reading',
    ]
    said = (
        f"an archive with a line per reading: '{named}' names {len(names)} channels, '{value}' is the reading, "
        f"'{time}' its time"
    )
    return Archive(series, "\n".join(lines), said, tuple(left))


def _text(name: str) -> str:
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"').replace("\t", "\\t") + '"'
