"""What a log holds: its description at once, values by slice or in blocks."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

from campaigns.log.guard import (
    check_chunks,
    first_line,
    is_packed,
    refuse,
)
from campaigns.log.limits import BLOCK_ROWS, BLOCK_VALUES
from campaigns.log.schema import (
    Channel,
    Header,
    LogSegment,
)
from sim_backend.errors import ConfigError, DataError

Array = NDArray[np.float64]
T = TypeVar("T")
LARGEST, SMALLEST = 1e100, 1e-100
"""Sizes in SI that no reading has; squares and ratios of others stay numbers."""


class NoMemoryError(DataError):
    """Values take more memory than there is; the file that holds them is not said to be damaged."""


@dataclass(frozen=True)
class Run:
    """One recorded run, opened by `probe.read_run`; close it or use it as a context manager.

    `rows` is the number of committed samples of every channel; nothing beyond is ever read. `expected_rows` is what a
    complete run has, None where nobody knew. `channels` and `segments` describe, `read`, `window` and `blocks` give
    values in SI units.
    """

    path: Path
    header: Header
    rows: int
    channels: Mapping[str, Channel]
    segments: tuple[LogSegment, ...]
    _file: h5py.File = field(repr=False, compare=False)
    _datasets: Mapping[str, h5py.Dataset] = field(repr=False, compare=False)
    expected_rows: int | None = None
    _kept: dict[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @property
    def run_uid(self) -> str:
        """The unique name of the run."""
        return self.header.run_uid

    @property
    def status(self) -> str:
        """How the run ended; `running` while its writer lives, `crashed` when that died."""
        return self.header.status

    @property
    def sample_rate_hz(self) -> float:
        """The rate that all channels share."""
        return next(iter(self.channels.values())).sample_rate_hz

    @property
    def chunk_rows(self) -> int:
        """Samples that are stored, checked and lost together."""
        return min((dataset.chunks or (BLOCK_ROWS,))[0] for dataset in self._datasets.values())

    @property
    def stored_rows(self) -> int:
        """Samples of the longest dataset; more than `rows` while being written or after a kill."""
        return max(dataset.shape[0] for dataset in self._datasets.values())

    def names(self, role: str) -> tuple[str, ...]:
        """Return the names of the channels with this role, in the order of the log."""
        return tuple(name for name, channel in self.channels.items() if channel.role == role)

    def only(self, names: Collection[str]) -> Run:
        """Return this run with these of its channels alone; what `once` finds is that of the whole run."""
        return replace(self, channels={name: channel for name, channel in self.channels.items() if name in names})

    def read(self, name: str, start: int = 0, stop: int | None = None) -> Array:
        """Return samples `start` to `stop` (exclusive; default: all committed) of a channel as (n,), SI.

        Raises ConfigError for an unknown channel or sample, DataError where the file is damaged and for numbers that
        nothing can be computed with (larger than LARGEST, or all of them smaller than SMALLEST and not zero),
        NoMemoryError where the memory does not suffice.
        """
        values = self.stored(name, start, stop)
        # holes are no numbers, and every user of values looks for them
        size = float(max(np.fmax.reduce(values), -np.fmin.reduce(values))) if values.size else 0.0
        if LARGEST < size < np.inf or 0.0 < size < SMALLEST:
            limits = f"it must lie between {SMALLEST:g} and {LARGEST:g}, others are beyond what any sensor reads"
            what = f"holds {size:.4g} as its largest number; {limits}"
            raise refuse(self.path, name, what, "correct its unit or scale where it was made")
        return values

    def stored(self, name: str, start: int = 0, stop: int | None = None) -> Array:
        """Return samples (n,) as `read` does, whatever numbers they hold: to copy them, or to say what is wrong."""
        last = self.rows if stop is None else stop
        if not 0 <= start <= last <= self.rows:
            raise ConfigError(f"samples {start} to {last} of {self.path}: it holds samples 0 to {self.rows}")
        try:
            return np.asarray(self._dataset(name)[start:last], dtype=np.float64)
        except (OSError, RuntimeError, ValueError, MemoryError) as error:
            if without_memory(error):
                raise NoMemoryError(
                    f"{self.path}: samples {start} to {last} of '{name}' take more memory than there is: free some, or "
                    "read fewer samples"
                ) from None
            what = f"cannot be read from sample {start} to {last} ({first_line(error)})"
            raise refuse(self.path, name, what, "run `mccd log recover`, or restore the file from a copy") from None

    def time_s(self, name: str, start: int = 0, stop: int | None = None) -> Array:
        """Return the times of samples `start` to `stop` of a channel as (n,); raises ConfigError as `read`."""
        channel = self._described(name)
        return channel.t0_s + np.arange(start, self.rows if stop is None else stop) / channel.sample_rate_hz

    def once(self, name: str, make: Callable[[Run], T]) -> T:
        """Return what `make` finds in this run, found only once however many ask under this name."""
        if name not in self._kept:
            self._kept[name] = make(self)
        found: T = self._kept[name]
        return found

    def window(self, label: str) -> Window:
        """Return the samples of the segment `label`; raises ConfigError naming those there are."""
        for segment in self.segments:
            if segment.label == label:
                return Window(self, segment)
        raise ConfigError(
            f"{self.path} has no segment '{label}': it has {_listed(part.label for part in self.segments)}"
        )

    def blocks(
        self,
        names: Iterable[str] | None = None,
        start: int = 0,
        stop: int | None = None,
        rows: int | None = None,
    ) -> Iterator[tuple[int, dict[str, Array]]]:
        """Yield samples `start` to `stop` in blocks of at most `rows`, as (first sample, {name: values (rows,)}), SI.

        Without `rows`, as many as keep the memory of a block whatever the number of channels. Raises as `stored`.
        """
        chosen = tuple(self.channels if names is None else names)
        rows = self._block_rows(len(chosen)) if rows is None else rows
        if rows < 1:
            raise ConfigError(f"blocks of {rows} samples: ask for at least 1")
        last = self.rows if stop is None else stop
        for first in range(start, last, rows):
            until = min(first + rows, last)
            yield first, {name: self.stored(name, first, until) for name in chosen}

    def _block_rows(self, channels: int) -> int:
        rows = min(BLOCK_ROWS, max(BLOCK_VALUES // max(channels, 1), 1))
        chunk = self.chunk_rows
        return rows // chunk * chunk if BLOCK_ROWS > rows >= chunk else rows

    def packed(self) -> list[str]:
        """Return the names of the channels whose values are compressed."""
        return [name for name, dataset in self._datasets.items() if is_packed(dataset)]

    def check_chunks(self) -> None:
        """Raise DataError where a chunk has another size than it must have; no value is read."""
        for dataset in self._datasets.values():
            check_chunks(dataset, self.path)

    def close(self) -> None:
        """Close the file; the description stays usable, the values do not."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _described(self, name: str) -> Channel:
        if name not in self.channels:
            raise ConfigError(f"{self.path} has no channel '{name}': it has {_listed(self.channels)}")
        return self.channels[name]

    def _dataset(self, name: str) -> h5py.Dataset:
        self._described(name)
        return self._datasets[name]


@dataclass(frozen=True)
class Window:
    """The samples of one segment of a run."""

    run: Run
    segment: LogSegment

    @property
    def settings(self) -> Mapping[str, Any]:
        """The settings under which the segment was recorded."""
        return self.segment.settings

    def read(self, name: str) -> Array:
        """Return the segment's samples of a channel as (n,) in SI units; raises as `Run.read`."""
        return self.run.read(name, self.segment.start, self.segment.stop)

    def time_s(self, name: str) -> Array:
        """Return the times of the segment's samples as (n,); raises as `Run.time_s`."""
        return self.run.time_s(name, self.segment.start, self.segment.stop)

    def blocks(
        self, names: Iterable[str] | None = None, rows: int | None = None
    ) -> Iterator[tuple[int, dict[str, Array]]]:
        """Yield blocks of the segment as (first sample, {name: values (rows,)}), SI; counted from the run's start.

        `names` selects channels (default: all), `rows` bounds a block. Raises as `Run.blocks`.
        """
        return self.run.blocks(names, self.segment.start, self.segment.stop, rows)


def without_memory(error: BaseException) -> bool:
    """Tell whether memory is short: HDF5 has no error of its own kind for that."""
    return isinstance(error, MemoryError) or "allocat" in first_line(error)


def _listed(names: Iterable[str]) -> str:
    known = sorted(names)
    more = f" and {len(known) - 20} more" if len(known) > 20 else ""
    return ", ".join(known[:20]) + more or "none"
