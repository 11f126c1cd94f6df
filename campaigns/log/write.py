"""The writer of a log: whole-chunk appends, the counter of committed samples last, a checksum at close.

A chunk that holds committed samples is never touched again, so a process killed at any moment leaves every
committed sample as it was. The samples of the unfinished chunk (at most `chunk_rows - 1`) are the price of that.
"""

from __future__ import annotations

import contextlib
import os
import uuid
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray

from campaigns.log import own
from campaigns.log.checksum import write_sidecar
from campaigns.log.create import SEGMENTS_PER_CHUNK, lay_out, storable
from campaigns.log.disk_space import CLOSING_BYTES, give_back, rows_bytes, take
from campaigns.log.failure import cannot, let_go
from campaigns.log.limits import MAX_CHUNK_ROWS, MAX_SETTINGS_BYTES, check_channels, check_segments
from campaigns.log.schema import (
    CHANNELS,
    COMMITTED,
    FINAL_STATUSES,
    OPEN_STATUS,
    OPEN_STOP,
    SEGMENTS,
    Channel,
    ChannelLike,
    Header,
    segment_dtype,
    to_json,
)
from campaigns.names import check_label
from campaigns.version import tool_version as installed_version
from sim_backend.errors import ConfigError, MccdError
from sim_backend.safe_write import give_name, hidden_name, require_ordinary

CHUNK_ROWS = 4096
SETTINGS_BYTES = 1024


def require_new(target: Path) -> None:
    """Raise ConfigError where a log cannot get the name `target`: something stands there, or no file may."""
    require_ordinary(target)
    if target.exists():
        raise ConfigError(f"{target} exists and a log never overwrites: choose another path with --out")


class LogWriter:
    """One run being recorded into a new file; use it as a context manager.

    Leaving the context normally ends the run as `complete` (or as `set_status` said), an exception as
    `failed` and an interrupt as `aborted`. Make one with `LogWriter.create`.
    """

    def __init__(self, path: Path, file: h5py.File, channels: tuple[Channel, ...], chunk_rows: int) -> None:
        self.path = path
        self.channels = channels
        self.status = OPEN_STATUS
        self.status_reason = ""
        self.committed_rows = 0
        self.run_uid = str(file.attrs["run_uid"])
        self._file = file
        self._datasets = [file[CHANNELS][channel.name] for channel in channels]
        self._segments = file[SEGMENTS]
        self._settings_bytes = int(self._segments.dtype["settings"].itemsize)
        self._buffer = np.empty((len(channels), chunk_rows))
        self._fill = 0
        self._labels: set[str] = set()
        self._in_segment = False
        self._closed = False
        self._broken = False
        self._own = own.begin(path)
        self._room_rows, self._room_segments = -1, 0  # for which space is reserved, besides that for closing

    @classmethod
    def create(
        cls,
        path: str | os.PathLike[str],
        channels: Sequence[ChannelLike],
        *,
        test: str,
        bench: Mapping[str, str],
        configuration: str = "",
        seed: int | None = None,
        run_uid: str | None = None,
        started_utc: str | None = None,
        tool_version: str | None = None,
        tool_commit: str = "unknown",
        chunk_rows: int = CHUNK_ROWS,
        settings_bytes: int = SETTINGS_BYTES,
        expected_rows: int | None = None,
        expected_segments: int = 0,
        note: str = "",
    ) -> LogWriter:
        """Make the file, complete with its header, under a hidden name and only then give it its own.

        `channels` are in the order of the columns; all share one sample rate. `settings_bytes` is the space
        for each segment's settings as JSON, `expected_rows` how long a complete run is, `note` what a user says of it.
        Raises ConfigError for an existing path, a header that a log cannot hold, and more channels or
        `expected_segments` than any reader takes; DataError when the file cannot be made.
        """
        header = Header(
            run_uid=uuid.uuid4().hex if run_uid is None else run_uid,
            test=test,
            bench=dict(bench),
            configuration=configuration,
            seed=seed,
            started_utc=_now() if started_utc is None else started_utc,
            tool_version=installed_version() if tool_version is None else tool_version,
            tool_commit=tool_commit,
            note=note,
        )
        columns = _checked(channels)
        _check_sizes(chunk_rows, settings_bytes, expected_segments)
        target = Path(path)
        require_new(target)
        hidden = hidden_name(target)
        try:
            file = h5py.File(hidden, "x")
            try:
                lay_out(file, header, columns, chunk_rows, settings_bytes, expected_rows)
                file.flush()
                give_name(hidden, target, replace=False)
            except BaseException:
                let_go(file)
                raise
        except BaseException as error:
            with contextlib.suppress(OSError):  # the first error is the one to report
                hidden.unlink()
            if isinstance(error, OSError | RuntimeError):
                raise cannot("make", target, error) from None
            raise
        return cls(target, file, columns, chunk_rows)

    @property
    def rows(self) -> int:
        """Samples appended so far, committed or waiting for their chunk to fill."""
        return self.committed_rows + self._fill

    def reserve(self, rows: int) -> None:
        """Reserve disk space for `rows` more samples, before they are measured; it is kept until they come.

        Raises DataError when the disk has not so much; what was committed can still be completed.
        """
        self._require_open()
        self._take_room(rows)

    def begin_segment(self, label: str, settings: Mapping[str, Any] | None = None) -> None:
        """Let the samples that follow belong to the segment `label`, which must be new in this log.

        Raises ConfigError for a label or settings that do not fit, or while another segment is open.
        """
        self._require_open()
        check_label(label)
        text = to_json(settings or {}, f"settings of segment '{label}'").encode()
        if self._in_segment or label in self._labels or len(text) > self._settings_bytes:
            raise ConfigError(self._refusal(label, len(text)))
        index = len(self._labels)
        check_segments(index + 1, self._segments.dtype.itemsize)
        self._need_room(0, 1)
        row = np.array((label.encode(), self.rows, OPEN_STOP, text), dtype=self._segments.dtype)
        with self._writing():
            self._segments.resize((index + 1,))
            self._segments[index] = row
        self._labels.add(label)
        self._room_segments -= 1
        self._in_segment = True

    def end_segment(self) -> None:
        """End the open segment at the samples appended so far; raises ConfigError when none is open."""
        self._require_open()
        if not self._in_segment:
            raise ConfigError("no segment is open: begin one before ending it")
        with self._writing():
            self._segments["stop", len(self._labels) - 1] = self.rows
        self._in_segment = False

    @contextlib.contextmanager
    def segment(self, label: str, settings: Mapping[str, Any] | None = None) -> Iterator[None]:
        """Put the samples appended inside the block into the segment `label`; raises as `begin_segment`."""
        self.begin_segment(label, settings)
        yield
        self.end_segment()

    def append(self, block: Mapping[str, ArrayLike]) -> None:
        """Append the same number of samples to every channel; `block` maps each channel's name to an array (n,).

        Raises ConfigError when names or lengths do not match, DataError when the file cannot take the samples.
        """
        self._require_open()
        columns = self._columns(block)
        total, chunk = columns[0].size, self._buffer.shape[1]
        done = 0
        while done < total:
            whole = (total - done) // chunk * chunk if self._fill == 0 else 0
            if whole:
                self._commit([column[done : done + whole] for column in columns])
                done += whole
                continue
            take = min(chunk - self._fill, total - done)
            for row, column in zip(self._buffer, columns, strict=True):
                row[self._fill : self._fill + take] = column[done : done + take]
            self._fill += take
            done += take
            if self._fill == chunk:
                self._fill = 0
                self._commit(list(self._buffer))

    def set_status(self, status: str, reason: str = "") -> None:
        """Choose the status that closing will write; raises ConfigError unless it is a final one."""
        if status not in FINAL_STATUSES:
            raise ConfigError(f"status '{status}' cannot end a run: use one of {', '.join(FINAL_STATUSES)}")
        self.status, self.status_reason = status, reason

    def close(self) -> None:
        """Commit the last samples, write the status, close and write the checksum; a second call does nothing.

        Raises DataError when the file cannot be completed; its committed samples stay readable.
        """
        if self._closed:
            return
        self._closed = True
        own.end(self._own)
        if self.status == OPEN_STATUS:
            self.status = "complete"
        if self._broken:
            let_go(self._file)
            return
        try:
            self._finish()
        except (OSError, RuntimeError, ValueError, MccdError) as error:
            let_go(self._file)
            raise error if isinstance(error, MccdError) else cannot("complete", self.path, error) from None
        try:
            size_bytes = self._file.id.get_filesize()
            self._file.close()
            give_back(self.path, size_bytes)
            write_sidecar(self.path)
            own.keep(self.path)
        except (OSError, RuntimeError) as error:
            raise cannot("complete", self.path, error) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
            return
        if isinstance(error, Exception):
            self.set_status("failed", f"{type(error).__name__}: {error}"[:1000])
        else:
            self.set_status("aborted", f"interrupted ({type(error).__name__})")
        with contextlib.suppress(MccdError):  # the error that ended the run is the one to report
            self.close()

    def _finish(self) -> None:
        self._need_room(0, 0)
        for dataset in self._datasets:  # an interrupt may have left some columns longer than the others
            dataset.resize((self.committed_rows,))
        tail, self._fill = self._buffer[:, : self._fill], 0
        if tail.size:
            self._commit(list(tail))
        if self._in_segment:
            self._segments["stop", len(self._labels) - 1] = self.committed_rows
        for name, text in (
            ("status", self.status),
            ("status_reason", self.status_reason),
            ("ended_utc", _now()),
        ):
            self._file.attrs.modify(name, storable(text))
        self._file.flush()

    def _commit(self, columns: list[NDArray[np.float64]]) -> None:
        first, last = self.committed_rows, self.committed_rows + columns[0].size
        self._need_room(columns[0].size, 0)
        with self._writing():
            for dataset, column in zip(self._datasets, columns, strict=True):
                dataset.resize((last,))
                dataset[first:last] = column
            self._file.flush()
            self._file[COMMITTED][()] = last
            self._file.flush()
        self.committed_rows = last
        self._room_rows -= columns[0].size

    def _need_room(self, rows: int, segments: int) -> None:
        """Reserve space only where `reserve` has not: the disk may have filled since."""
        if rows > self._room_rows or segments > self._room_segments:
            self._take_room(max(rows, self._room_rows, 0))

    def _take_room(self, rows: int) -> None:
        need = rows_bytes(self._fill + rows, self._buffer.shape[1], len(self.channels)) + CLOSING_BYTES
        need += SEGMENTS_PER_CHUNK * int(self._segments.dtype.itemsize)
        try:
            take(self._file, need)
        except OSError as error:
            raise cannot("write", self.path, error, f" ({rows} samples more take {need / 1e6:.3g} MB)") from None
        self._room_rows, self._room_segments = self._fill + rows, SEGMENTS_PER_CHUNK

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (OSError, RuntimeError, ValueError) as error:
            self._broken = True
            raise cannot("write", self.path, error) from None

    def _columns(self, block: Mapping[str, ArrayLike]) -> list[NDArray[np.float64]]:
        names = [channel.name for channel in self.channels]
        if set(block) != set(names):
            raise ConfigError(
                f"samples hold channels {', '.join(sorted(block))}, the log {', '.join(sorted(names))}: "
                "append exactly these"
            )
        columns = [np.asarray(block[name], dtype=np.float64) for name in names]
        if any(column.ndim != 1 or column.size != columns[0].size for column in columns):
            shapes = ", ".join(f"{name} {column.shape}" for name, column in zip(names, columns, strict=True))
            raise ConfigError(f"samples differ in shape ({shapes}): append one-dimensional arrays of one length")
        return columns

    def _refusal(self, label: str, settings_bytes: int) -> str:
        if self._in_segment:
            return f"segment '{label}' begins while another is open: end that one first"
        if label in self._labels:
            return f"segment '{label}' exists in this log: labels are unique, choose another"
        return (
            f"settings of segment '{label}' take {settings_bytes} bytes of at most {self._settings_bytes}: "
            "move them to the configuration or create the log with a larger settings_bytes"
        )

    def _require_open(self) -> None:
        if self._closed or self._broken:
            state = "closed" if self._closed else "no longer writable"
            raise ConfigError(f"{self.path} is {state}: create a new log for new samples")


def _check_sizes(chunk_rows: int, settings_bytes: int, segments: int) -> None:
    if not (1 <= chunk_rows <= MAX_CHUNK_ROWS and 2 <= settings_bytes <= MAX_SETTINGS_BYTES):
        raise ConfigError(
            f"chunk_rows {chunk_rows} must lie in 1 to {MAX_CHUNK_ROWS}, "
            f"settings_bytes {settings_bytes} in 2 to {MAX_SETTINGS_BYTES}: choose values within"
        )
    check_segments(segments, segment_dtype(settings_bytes).itemsize)


def _checked(channels: Sequence[ChannelLike]) -> tuple[Channel, ...]:
    check_channels(len(channels))
    columns = tuple(Channel.of(channel) for channel in channels)
    names = [column.name for column in columns]
    if not columns or len(set(names)) != len(names):
        raise ConfigError(f"a log needs at least one channel and unique names, got {names}: name each channel once")
    rates = {column.sample_rate_hz for column in columns}
    if len(rates) > 1:
        raise ConfigError(f"channels have sample rates {sorted(rates)} Hz: all channels of a log share one, resample")
    return columns


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")
