"""Points of a frequency-response table that were measured several times at one level: averaged, and said so."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.identification.response_table import Table
from sim_backend.errors import DataError

Array = NDArray[np.float64]

CURVE_LINES = 8
"""Points that share a value of a column from which on that value counts as a curve of its own."""


@dataclass(frozen=True)
class Averaged:
    """A table whose points (n,) differ in level or frequency, and how often each was measured, `count` (n,).

    `scatter` (samples, 3) holds the differences of repeated points from their mean, along its phase and across it, with
    the magnitude of their mean.
    """

    table: Table
    count: Array
    scatter: Array


def averaged(table: Table, path: Path) -> Averaged:
    """Return `table` with the points of one frequency and level replaced by their mean; remarks say how they scatter.

    Raises DataError where a column without a meaning separates the repeated points into curves: it may be the level.
    """
    f, level = table.frequency_hz, np.zeros(table.frequency_hz.size) if table.level is None else table.level
    key = np.stack([level, f], axis=1)
    _, first, back, count = np.unique(key, axis=0, return_index=True, return_inverse=True, return_counts=True)
    back = back.reshape(-1)
    again = count[back] > 1
    _require_no_curves(path, table, back, again)
    mean = (np.bincount(back, table.response.real) + 1j * np.bincount(back, table.response.imag)) / count
    off = (
        (table.response - mean[back])
        * np.exp(-1j * np.angle(mean[back]))
        * np.sqrt(count / np.maximum(count - 1, 1))[back]
    )
    scatter = np.stack([off.real, off.imag, np.abs(mean[back])], axis=1)[again]
    merged = replace(
        table,
        frequency_hz=f[first],
        response=mean.astype(np.complex128),
        level=None if table.level is None else table.level[first],
        # repeated points are averaged; each had its own deviation
        std=None if table.std is None else np.sqrt(np.bincount(back, table.std**2)) / count,
        coherence=None if table.coherence is None else np.bincount(back, table.coherence) / count,
        unnamed={name: values[first] for name, values in table.unnamed.items()},
        remarks=(*table.remarks, *_remark(path, count, scatter)),
    )
    return Averaged(merged, count.astype(float), scatter)


def _remark(path: Path, count: NDArray[np.intp], scatter: Array) -> tuple[str, ...]:
    several = int(np.count_nonzero(count > 1))
    if not several:
        return ()
    along, across, size = scatter.T
    part = float(np.median(np.hypot(along, across) / np.maximum(size, np.finfo(float).tiny)))
    return (
        f"{path.name}: {several} of {count.size} points were measured several times at one level and are averaged. "
        f"They scatter by {100.0 * part:.3g} % (median); add a column 'level' if the excitation differed",
    )


def _require_no_curves(path: Path, table: Table, back: NDArray[np.intp], again: NDArray[np.bool_]) -> None:
    """Raise DataError if values of an unnamed column, each on many points, differ where a point is repeated."""
    for name, values in table.unnamed.items():
        some = values[again]
        if not some.size or not np.isfinite(some).all():
            continue
        different, sizes = np.unique(some, return_counts=True)
        pairs = np.unique(np.stack([back[again].astype(float), some], axis=1), axis=0)
        if different.size < 2 or sizes.min() < CURVE_LINES or pairs.shape[0] == np.unique(back[again]).size:
            continue
        shown = ", ".join(f"{one:g}" for one in different[:5])
        raise DataError(
            f"{path}: frequencies are repeated, with different values of '{name}' ({shown}), whose meaning is unknown: "
            "name it 'level (unit)' if it is the level of excitation, else remove the column, and repeated points are "
            "averaged"
        )
