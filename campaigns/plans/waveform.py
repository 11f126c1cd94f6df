"""A waveform from a CSV file, played open loop: a column per axis, a row per sample. Not a PLAN: it needs a file."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from campaigns.importing.text import CellError, TextSource
from campaigns.log import sha256_of
from campaigns.plans.base import Plan, axis_of, channels_of, longest_segment, open_loop, rate_of
from sim_backend.bench import Bench, Segment
from sim_backend.errors import DataError
from sim_backend.small_files import open_regular

Array = NDArray[np.float64]

MAX_BYTES = 1_000_000_000


class Waveform(Plan, frozen=True, kw_only=True):
    """Play the columns of `file`, named by axis, in N m (angles) or N (z), at the bench's rate, `repeats` times."""

    name: ClassVar[str] = "waveform"
    title: ClassVar[str] = "waveform from a file"

    file: str
    repeats: int = 1

    def __post_init__(self) -> None:
        self.require_positive("repeats")

    def configuration(self) -> dict[str, Any]:
        """Return what decides the segments: the settings and the file's checksum."""
        return super().configuration() | {"file_sha256": sha256_of(Path(self.file))}

    def channels(self, bench: Bench) -> tuple[str, ...]:
        """Return commands and readings, and the temperature."""
        return channels_of(bench, ("input", "output"), ("temperature",))

    def segments(self, bench: Bench) -> Iterator[Segment]:
        """Yield the waveform in stretches; raises DataError for a file that is not a waveform for this bench."""
        names, values = read_waveform(Path(self.file))
        command = np.zeros((values.shape[0], len(bench.axes)))
        command[:, [axis_of(bench, name) for name in names]] = values
        record, longest = self.channels(bench), longest_segment(rate_of(bench))
        self.require_run(bench, self.repeats * len(command), self.repeats * (len(command) / longest))
        for repeat in range(self.repeats):
            for part, first in enumerate(range(0, len(command), longest)):
                wave = command[first : first + longest]
                settings: dict[str, float | str] = {"phase": "waveform", "repeat": repeat, "first_sample": first}
                yield open_loop(f"waveform {repeat + 1}.{part + 1}", wave, len(wave), record, settings)


def read_waveform(path: Path) -> tuple[tuple[str, ...], Array]:
    """Return the column names and values (n, columns) of a CSV file; raises DataError for what is not a waveform."""
    try:
        os.close(open_regular(path))
        if path.stat().st_size > MAX_BYTES:
            raise DataError(f"{path}: {path.stat().st_size} bytes; a waveform takes at most {MAX_BYTES}")
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); check the path") from None
    table = TextSource(path, separator=",", decimal=".")
    try:
        names = tuple(table.names())
        if not names or len(set(names)) < len(names):
            raise DataError(f"columns {', '.join(names) or 'without names'}; name every column once, by its axis")
        values = np.array(table.array(""), dtype=np.float64)
    except CellError as error:
        raise DataError(
            f"{path}: row {error.line}, column {error.column} is not finite: it holds '{error.cell}'; mend the waveform"
        ) from None
    except DataError as error:
        raise DataError(
            f"{path}: cannot be read as CSV of numbers ({error}); write a head of axes, name every column once, then "
            "numbers, one row at least"
        ) from None
    return names, values
