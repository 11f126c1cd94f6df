"""Spectra of a record by blocks, none across a break: of whole periods where they repeat, of windowed blocks else."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from campaigns.facts.base import Array
from campaigns.facts.stretches import Stretch

Spectrum = NDArray[np.complex128]

EXCITED = 1e-3
"""Power of an input at a line from which on it is excited there, as a part of its strongest line's."""

MOST_VALUES = 4_000_000
"""Numbers that are transformed; of longer stretches blocks are left out, evenly."""


@dataclass(frozen=True)
class Blocks:
    """Spectra of inputs (b, f, n_u) and outputs (b, f, n_y) of `length` samples, at `line` (f,) over `length`.

    `start` (b,) is the first sample of each block, `stretch` (b,) the number of its stretch.
    """

    inputs: Spectrum
    outputs: Spectrum
    line: NDArray[np.intp]
    length: int
    start: NDArray[np.intp]
    stretch: NDArray[np.intp]

    def frequency_hz(self, rate_hz: float) -> Array:
        """Return the frequencies (f,)."""
        return np.asarray(self.line * (rate_hz / self.length))


def period_blocks(stretches: Sequence[Stretch]) -> list[Blocks]:
    """Return the spectra of all periods by their length, without the first where there are three or more."""
    found = []
    for period in sorted({s.period for s in stretches if s.periods >= 2}):
        some = [s for s in stretches if s.period == period and s.periods >= 2]
        first = [1 if s.periods >= 3 else 0 for s in some]
        starts = [np.arange(f, s.periods) * period for f, s in zip(first, some, strict=True)]
        found.append(_blocks(some, starts, period, np.ones(period)))
    return found


def windowed_blocks(stretches: Sequence[Stretch], length: int) -> Blocks | None:
    """Return the spectra of blocks of `length` samples that overlap by half, None where no stretch is as long."""
    some = [s for s in stretches if s.rows >= length]
    if not some:
        return None
    starts = [np.arange(0, s.rows - length + 1, length // 2) for s in some]
    return _blocks(some, starts, length, scipy.signal.windows.hann(length, sym=False))


def _blocks(some: Sequence[Stretch], starts: Sequence[NDArray[np.intp]], length: int, window: Array) -> Blocks:
    width = some[0].inputs.shape[1] + some[0].outputs.shape[1]
    lines = np.arange(1, (length + 1) // 2)  # without the mean and half the rate, which have no phase
    every = max(1, -(-sum(map(len, starts)) * length * width // MOST_VALUES))
    inputs: list[Spectrum] = []
    outputs: list[Spectrum] = []
    for s, own in zip(some, starts, strict=True):
        for at in own[::every]:
            for values, spectra in ((s.inputs, inputs), (s.outputs, outputs)):
                block = values[at : at + length]
                spectra.append(scipy.fft.rfft((block - block.mean(axis=0)) * window[:, None], axis=0)[lines])
    count = [len(own[::every]) for own in starts]
    return Blocks(
        np.array(inputs),
        np.array(outputs),
        lines,
        length,
        np.concatenate([s.start + own[::every] for s, own in zip(some, starts, strict=True)]),
        np.repeat(np.arange(len(some)), count),
    )


def excited(power: Array) -> NDArray[np.bool_]:
    """Return at which lines (f,) of an input's `power` (f, n_u) one of the inputs is excited."""
    return np.any(power > EXCITED * power.max(axis=0, keepdims=True), axis=1) & np.any(power > 0.0, axis=1)
