"""Two-dimensional stability of a chop: positions, scatter, percentage in the circle, repeatability, accuracy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.measurements.arrays import finite
from analysis.measurements.settling import BAND_RAD
from analysis.measurements.spread import spread
from sim_backend.errors import DataError

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChopStability:
    """What `p` observation positions show, in rad; arrays (p, 2) hold θx and θy, arrays (p,) both together.

    `mean_rad` is over all windows of a position. `three_sigma_rad` is three times the rms offset from that mean,
    within and between windows; `three_sigma_std_rad` its uncertainty for coloured noise. `inside_percent` of the
    samples lie within the circle about the mean, `inside_std` is from the scatter between windows.
    `repeatability_rad` is the largest distance of a window's mean from the mean of all, `accuracy_rad` the distance
    of the mean from what was commanded.
    """

    mean_rad: Array
    three_sigma_rad: Array
    three_sigma_std_rad: Array
    inside_percent: Array
    inside_std: Array
    repeatability_rad: Array
    accuracy_rad: Array

    @property
    def stability_rad(self) -> float:
        """Largest 3σ over positions and axes: what is compared with the requirement (Table 6.6)."""
        return float(np.max(self.three_sigma_rad))


def observation_windows(values: ArrayLike, levels: int, dwell: int, window: int) -> Array:
    """Return the last `window` samples of every dwell as (levels, cycles, window, k) from a chop (n, k).

    Only whole cycles of `levels` dwells of `dwell` samples are used. Raises DataError when there is none, or a window
    outlasts its dwell.
    """
    y = finite("chop", values, 2)
    cycles = y.shape[0] // (levels * dwell) if levels > 0 and dwell > 0 else 0
    if cycles == 0 or not 0 < window <= dwell:
        raise DataError(
            f"chop: {y.shape[0]} samples, {levels} levels of {dwell} samples, windows of {window}; "
            "it needs one whole cycle, and windows within a dwell"
        )
    cut = y[: cycles * levels * dwell].reshape(cycles, levels, dwell, -1)[:, :, dwell - window :]
    return np.ascontiguousarray(cut.transpose(1, 0, 2, 3))


def offsets(windows_rad: ArrayLike) -> Array:
    """Return offsets from the mean position, (p, samples, 2), from windows (p, cycles, window, 2); Fig. 6.12."""
    w = finite("chop windows", windows_rad, 4, least=1)
    return (w - w.mean(axis=(1, 2), keepdims=True)).reshape(w.shape[0], -1, w.shape[3])


def chop_stability(windows_rad: ArrayLike, commanded_rad: ArrayLike, radius_rad: float = BAND_RAD) -> ChopStability:
    """Return the stability from windows (p, cycles, window, 2) and the commanded angles (p, 2); Tables 6.6 and 6.7.

    Raises DataError for windows of fewer than three samples, shapes that do not fit, or numbers that are not finite.
    """
    return stability_of_blocks(lambda: iter((windows_rad,)), commanded_rad, radius_rad)


def stability_of_blocks(
    blocks: Callable[[], Iterator[ArrayLike]], commanded_rad: ArrayLike, radius_rad: float = BAND_RAD
) -> ChopStability:
    """Return the same from windows that come in blocks of some cycles, two times over: memory is that of one block.

    Shapes and errors raised as in `chop_stability`.
    """
    target = finite("commanded angles", commanded_rad, 2, least=1)
    sums, kept = [], list[Array]()
    for rows in _rows(blocks(), target):
        sums.append((rows.sum(axis=(2, 3)), rows.shape[2] * rows.shape[3], rows.mean(axis=3)))
        kept = [rows] if len(sums) == 1 else []  # a single block need not be made again
    count = sum(part[1] for part in sums)
    mean = np.sum([part[0] for part in sums], axis=0) / count
    window_means = np.concatenate([part[2] for part in sums], axis=2) - mean[:, :, None]
    squares, inside, errors = [], [], []
    for rows in kept or _rows(blocks(), target):
        off = rows - mean[:, :, None, None]
        of_window = (off**2).sum(axis=3)
        squares.append(of_window.sum(axis=2))
        inside.append(100.0 * (np.hypot(off[:, 0], off[:, 1]) <= radius_rad).mean(axis=2))
        errors.append(_sigma_errors(rows))
    per_window, cycles = np.concatenate(inside, axis=1), window_means.shape[2]
    std_error = np.sqrt(np.mean(np.concatenate(errors, axis=2) ** 2, axis=2) / cycles)
    return ChopStability(
        mean_rad=mean,
        three_sigma_rad=3.0 * np.sqrt(np.sum(squares, axis=0) / count),
        three_sigma_std_rad=3.0 * std_error,
        inside_percent=per_window.mean(axis=1),
        inside_std=per_window.std(axis=1, ddof=1) / np.sqrt(cycles) if cycles > 1 else np.zeros(len(target)),
        repeatability_rad=np.max(np.hypot(window_means[:, 0], window_means[:, 1]), axis=1),
        accuracy_rad=np.hypot(*(mean - target).T),
    )


def _rows(blocks: Iterator[ArrayLike], target: Array) -> Iterator[Array]:
    """Yield windows as (p, 2, cycles, window): sums over a window are faster where it lies together."""
    for block in blocks:
        w = finite("chop windows", block, 4, least=3, axis=2)
        if w.shape[3] != 2 or target.shape != (w.shape[0], 2):
            raise DataError(
                f"chop: windows {w.shape} and commanded angles {target.shape}; "
                "give two axes and one command per position"
            )
        yield np.ascontiguousarray(w.transpose(0, 3, 1, 2))


def _sigma_errors(rows: Array) -> Array:
    """Uncertainty of the σ of each window, (p, 2, cycles), by its own periodogram."""
    return spread(rows.reshape(-1, rows.shape[3]).T).std_error.reshape(rows.shape[:3])
