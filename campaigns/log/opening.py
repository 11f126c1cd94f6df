"""From the file of a log to its description, before any value is read: from files nobody has to trust."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import h5py
import numpy as np

from campaigns.log.guard import (
    check_total,
    first_line,
    link_names,
    member,
    number_attribute,
    open_h5,
    refuse,
    text_attribute,
)
from campaigns.log.limits import MAX_SEGMENT_TABLE_BYTES, MAX_SEGMENTS, readable_note
from campaigns.log.read import NoMemoryError, Run, without_memory
from campaigns.log.schema import (
    CHANNELS,
    COMMITTED,
    EXPECTED,
    OPEN_STATUS,
    OPEN_STOP,
    SCHEMA,
    SEGMENTS,
    Channel,
    Header,
    LogSegment,
)
from sim_backend.errors import ConfigError, DataError
from sim_backend.small_files import open_regular

T = TypeVar("T")
_SEGMENTS_AT_ONCE = 1024
_SEGMENT_FIELDS = {"label": "S", "start": "i", "stop": "i", "settings": "S"}


def open_run(target: Path) -> Run:
    """Open the log at `target` without a first look by `probe`; raises DataError if it is not a sound log."""
    return _told_of(target, open_h5(target), _described_run)


def read_header(target: Path) -> Header:
    """Return the header of the log at `target` alone, whatever its channels hold; raises as `open_run`."""
    file = open_h5(target)
    header = _told_of(target, file, _header)
    file.close()
    return header


def _told_of(target: Path, file: h5py.File, tell: Callable[[Path, h5py.File], T]) -> T:
    """Return what `tell` finds in a file that is open; closes it and raises DataError where it is not a sound log."""
    try:
        _require_schema(target, file)
        return tell(target, file)
    except DataError:
        file.close()
        raise
    except ConfigError as error:  # the schema's own checks, met here in a file instead of in a call
        file.close()
        raise DataError(f"{target}: {error}") from None
    except (OSError, RuntimeError, ValueError, TypeError, KeyError, OverflowError, MemoryError) as error:
        file.close()
        if without_memory(error):
            raise NoMemoryError(f"{target}: its description takes more memory than there is: free some") from None
        raise DataError(f"{target} is damaged: {first_line(error)}; run `mccd log verify`") from None


def _require_schema(path: Path, file: h5py.File) -> None:
    schema = text_attribute(file, "schema", path, default="")
    if schema != SCHEMA:
        raise DataError(
            f"{path} has schema {schema[:40]!r}, this version reads {SCHEMA!r}: "
            "if it is another tool's file, use `mccd import`"
        )


def _described_run(path: Path, file: h5py.File) -> Run:
    header = _header(path, file)
    group = member(file, CHANNELS, path)
    if not isinstance(group, h5py.Group):
        raise refuse(path, CHANNELS, "is not a group", "see docs/log-format.md")
    rows = _committed(path, file)
    datasets, channels = _channels(path, group, rows)
    segments = _segments(path, file, rows)
    expected = number_attribute(file, EXPECTED, path)
    return Run(
        path,
        header,
        rows,
        MappingProxyType(channels),
        segments,
        file,
        MappingProxyType(datasets),
        None if expected is None else int(expected),
    )


def _header(path: Path, file: h5py.File) -> Header:
    texts = {
        name: text_attribute(file, name, path)
        for name in (
            "run_uid",
            "test",
            "configuration",
            "started_utc",
            "tool_version",
            "tool_commit",
            "status",
        )
    }
    texts |= {name: text_attribute(file, name, path, default="") for name in ("status_reason", "ended_utc", "note")}
    texts["note"] = readable_note(texts["note"])
    if texts["status"] == OPEN_STATUS and not has_writer(path):
        texts["status"], texts["status_reason"] = "crashed", "its writer ended without closing it"
    seed = number_attribute(file, "seed", path)
    bench = _object(text_attribute(file, "bench", path), path, "bench")
    return Header(bench=bench, seed=None if seed is None else int(seed), **texts)


def has_writer(path: Path, *, unknown: bool = True) -> bool:
    """Return whether a process holds the lock that HDF5 takes for writing; `unknown` where locks do not exist."""
    try:
        import fcntl
    except ImportError:
        return unknown
    with open(open_regular(path), "rb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:  # a file system without locks
            return unknown
    return False


def _committed(path: Path, file: h5py.File) -> int:
    counter = member(file, COMMITTED, path)
    if not isinstance(counter, h5py.Dataset) or counter.shape != () or counter.dtype.kind not in "iu":
        raise refuse(path, COMMITTED, "is not a single integer", "see docs/log-format.md")
    rows = int(counter[()])
    if rows < 0:
        raise refuse(path, COMMITTED, f"is {rows}, less than 0", "restore the file from a copy")
    return rows


def _channels(path: Path, group: h5py.Group, rows: int) -> tuple[dict[str, h5py.Dataset], dict[str, Channel]]:
    found: list[tuple[int, Channel, h5py.Dataset]] = []
    names = link_names(group, path)
    for name in names:
        dataset = member(group, name, path, len(names))
        item = f"{CHANNELS}/{name}"
        if not isinstance(dataset, h5py.Dataset) or dataset.ndim != 1 or dataset.dtype.kind not in "fiu":
            raise refuse(path, item, "is not a one-dimensional dataset of numbers", "see docs/log-format.md")
        if dataset.shape[0] < rows:
            what = f"has {dataset.shape[0]} samples, fewer than the {rows} committed ones"
            raise refuse(path, item, what, "restore the file from a copy")
        rate, t0_s = (number_attribute(dataset, key, path) for key in ("sample_rate_hz", "t0_s"))
        if rate is None:
            raise refuse(path, item, "has no sample_rate_hz", "see docs/log-format.md")
        unit, role = (text_attribute(dataset, key, path) for key in ("unit", "role"))
        dof = text_attribute(dataset, "dof", path, default="")
        index = number_attribute(dataset, "index", path)
        channel = Channel(name, unit, role, dof, float(rate), float(t0_s or 0.0))
        found.append((len(found) if index is None else int(index), channel, dataset))
    if len({channel.sample_rate_hz for _, channel, _ in found}) != 1:
        raise refuse(path, CHANNELS, "has no channels, or channels of different rates", "see docs/log-format.md")
    check_total((dataset for _, _, dataset in found), path)
    found.sort(key=lambda entry: entry[0])
    return (
        {channel.name: dataset for _, channel, dataset in found},
        {channel.name: channel for _, channel, _ in found},
    )


def _segments(path: Path, file: h5py.File, rows: int) -> tuple[LogSegment, ...]:
    table = member(file, SEGMENTS, path)
    kinds = table.dtype.fields if isinstance(table, h5py.Dataset) else None
    if kinds is None or {name: kind[0].kind for name, kind in kinds.items()} != _SEGMENT_FIELDS or table.ndim != 1:
        raise refuse(path, SEGMENTS, "is not a table of label, start, stop, settings", "see docs/log-format.md")
    most = min(MAX_SEGMENTS, MAX_SEGMENT_TABLE_BYTES // table.dtype.itemsize)
    if table.shape[0] > most:
        raise refuse(path, SEGMENTS, f"has {table.shape[0]} rows of at most {most}", "split the run")
    segments: list[LogSegment] = []
    labels: set[str] = set()
    free = 0
    for raw in _rows_of(table):
        label, start, stop = raw["label"].decode("utf-8"), int(raw["start"]), int(raw["stop"])
        if not label or (start >= rows and stop != start):
            continue  # begun, but none of its samples was committed before the writer ended
        stop = rows if stop == OPEN_STOP else min(stop, rows)
        if not free <= start <= stop or label in labels:
            what = f"has segment {label!r} from sample {start} to {stop}, used twice or overlapping another"
            raise refuse(path, SEGMENTS, what, "restore the file from a copy")
        free = stop
        labels.add(label)
        settings = _object(raw["settings"].decode("utf-8"), path, f"{SEGMENTS}/{label}")
        segments.append(LogSegment(label, start, stop, MappingProxyType(settings)))
    return tuple(segments)


def _rows_of(table: h5py.Dataset) -> Iterator[np.void]:
    for first in range(0, table.shape[0], _SEGMENTS_AT_ONCE):
        yield from table[first : first + _SEGMENTS_AT_ONCE]


def _object(text: str, path: Path, item: str) -> dict[str, Any]:
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        value = None
    if not isinstance(value, dict):
        raise refuse(path, item, "is not a JSON object", "see docs/log-format.md")
    return value
