"""Segments of any length for a fit: what fits into memory is read as it is, more is averaged or read in parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.frequency.averaged_spectra import averaged_spectra
from analysis.frequency.frf import FrequencyResponse
from campaigns.log import LogSegment, Run
from campaigns.progress import Report, unheard

Array = NDArray[np.float64]

VALUES_AT_ONCE = 2_000_000
"""Numbers that a fit reads as they are, 16 MB; with what is made of them, some hundred MB."""

BLOCK_VALUES = 500_000

PIECE = 2**14
"""Samples of a piece whose spectra are averaged: 0.6 Hz at 10 kHz, where a bench's narrowest mode is 10 Hz wide."""

EXCITED = 1e-5
"""Least power of an input at a line, as a part of its strongest line's."""


def too_long(parts: Sequence[tuple[Run, LogSegment]]) -> bool:
    """Tell whether the inputs and outputs of all segments together are more than a fit reads as they are."""
    return sum(s.rows * _width(run) for run, s in parts) > VALUES_AT_ONCE


def together(parts: Sequence[tuple[Run, LogSegment]], period: int, periods: int) -> int:
    """Return how many of the `periods` of each segment go into one mean; two means at least are left of two or more."""
    values = period * periods * sum(_width(run) for run, _ in parts)
    return max(1, min(-(-values // VALUES_AT_ONCE), periods // 2))


def folded(run: Run, segment: LogSegment, role: str, period: int, periods: int, group: int) -> Array:
    """Return means over `group` consecutive periods, (periods // group, period, channels).

    They end with the first `periods` periods of the segment, so that the periods that are not used are nearest to the
    transient.
    """
    names, means = run.names(role), periods // group
    first = segment.start + (periods - means * group) * period
    out = np.zeros((means, period, len(names)))
    at_once = max(BLOCK_VALUES // (period * len(names)), 1)
    for begin in range(0, means * group, at_once):
        end = min(begin + at_once, means * group)
        rows = (first + begin * period, first + end * period)
        block = np.stack([run.read(name, *rows) for name in names], axis=1).reshape(end - begin, period, -1)
        np.add.at(out, np.arange(begin, end) // group, block)
    return out / group


def averaged_response(
    parts: Sequence[tuple[Run, LogSegment]], report: Report = unheard
) -> tuple[FrequencyResponse, Array, Array]:
    """Return the response of segments of any length and excitation, with mean inputs and outputs (channels, 1).

    Segments shorter than `PIECE` are ignored; raises DataError when the others are too short.
    """
    run = parts[0][0]
    inputs, outputs = run.names("input"), run.names("output")
    names, total, done = (*inputs, *outputs), float(sum(s.rows for _, s in parts)), 0

    def blocks(other: Run, segment: LogSegment) -> Iterator[Array]:
        nonlocal done
        for _, block in other.blocks(names, segment.start, segment.stop, BLOCK_VALUES // len(names) + 1):
            report(float(done), total, "averaging spectra")
            rows = np.stack([block[name] for name in names], axis=1)
            sums.append((rows.sum(axis=0), rows.shape[0]))
            done += rows.shape[0]
            yield rows

    sums: list[tuple[Array, int]] = []
    begin = parts[0][1].start
    first = np.array([run.read(name, begin, begin + 1)[0] for name in names])
    spectra = averaged_spectra((blocks(*part) for part in parts), PIECE, len(names), first)
    mean = (np.sum([s for s, _ in sums], axis=0) / total)[:, None]
    measured = spectra.response(run.sample_rate_hz, len(inputs), len(outputs), EXCITED)
    return measured, mean[: len(inputs)], mean[len(inputs) :]


def windowed(parts: Sequence[tuple[Run, LogSegment]]) -> list[tuple[Run, LogSegment]]:
    """Return the segments, each at most as long as is read at once: of a longer one only that much, in its middle."""
    cut = []
    for run, segment in parts:
        most = max(VALUES_AT_ONCE // _width(run), 1)
        start = segment.start + (segment.rows - most) // 2
        whole = segment.rows <= most
        cut.append((run, segment if whole else replace(segment, start=start, stop=start + most)))
    return cut


def _width(run: Run) -> int:
    return len(run.names("input")) + len(run.names("output"))
