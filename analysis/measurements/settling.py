"""Settling time and overshoot of moves, as the paper's requirement counts them: within ±1.7 µrad for good."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_backend.errors import DataError
from sim_backend.readings import first_absurd, said

Array = NDArray[np.float64]

BAND_RAD = 1.7e-6
"""Half width of the settling band: the positional stability that the instrument asks for (Table 6.6)."""


@dataclass(frozen=True)
class Settling:
    """Settling of `k` moves, each array (k,).

    `time_s` is the time, from the first sample, of the last sample outside the band: 0 when none is, infinite
    when the record ends outside. The output enters the band for good within one sample after it. `overshoot`
    is how far the output goes beyond `final` in the direction of the move, zero or more, in output units.
    """

    time_s: Array
    overshoot: Array
    final: Array


def settling(output: ArrayLike, rate_hz: float, final: ArrayLike | None = None, band: float = BAND_RAD) -> Settling:
    """Return the settling of moves (k, n), or of one move (n,), that all start at the first sample.

    `final` (k,) or a number is where they should end; without it, the mean over the last tenth of each
    record. Raises DataError when there are fewer than two samples, one is not finite, or the rate or the band
    is not positive.
    """
    y = np.atleast_2d(np.asarray(output, dtype=float))
    if y.ndim != 2 or y.shape[1] < 2:
        raise DataError(f"settling: the record has shape {y.shape}; give (moves, samples) with two samples or more")
    if (first := first_absurd(y)) is not None:
        row, column = first
        raise DataError(f"settling: sample {column} of move {row} is {said(y[first])}; leave that move out")
    if not (rate_hz > 0.0 and band > 0.0):
        raise DataError(f"settling: rate {rate_hz} Hz and band {band} must both be above zero")
    n = y.shape[1]
    tail = y[:, n - max(n // 10, 1) :].mean(axis=1)
    end = tail if final is None else np.broadcast_to(np.asarray(final, dtype=float), tail.shape).copy()
    error = y - end[:, None]
    outside = np.abs(error) > band
    last = np.where(outside.any(axis=1), n - 1 - np.argmax(outside[:, ::-1], axis=1), 0)
    time_s = np.where(outside[:, -1], np.inf, last / rate_hz)
    direction = np.where(y[:, 0] <= end, 1.0, -1.0)
    overshoot = np.maximum(np.max(direction[:, None] * error, axis=1), 0.0)
    return Settling(time_s, overshoot, end)
