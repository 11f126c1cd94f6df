"""The spectrum of what does not repeat.

What no model predicts is what does not repeat: of repeated periods the differences (orthonormal contrasts, so that they
are independent), of all else the residual. The whitening filter keeps its spectrum from leaking, and the filter's gain
is divided out again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.noise.whitener import band_of
from analysis.diagnosis.records.dataset import Record
from campaigns.facts.base import stretches_of
from sim_backend.linear import Array

_GROWTH, _LEAST_ROWS = 1.03, 8
"""Ratio of the edges of a bin, and how many numbers it holds at least."""

HIGHEST = 0.45
"""Frequencies are used up to this part of the sample rate."""

_CYCLES = 4.0
"""Frequencies are used from so many half waves in a series."""


@dataclass(frozen=True)
class Spectrum:
    """The mean power (n_y, k) of the residual in bins of `count` (k,) numbers at `frequency_hz` (k, points)."""

    frequency_hz: Array
    power: Array
    count: Array

    @property
    def edges_hz(self) -> Array:
        """Edges of the bins, shape (k + 1,): points are the middles of equal parts of a bin."""
        half = 0.5 * (self.frequency_hz[:, 1] - self.frequency_hz[:, 0])
        return np.append(self.frequency_hz[:, 0] - half, self.frequency_hz[-1, -1] + half[-1])


class Series(NamedTuple):
    """Samples that hold noise, whitened (m, n_y), and how much was played: `motion` (m,).

    That is the squared input in units of its mean square, summed over the inputs. Where periods repeat the samples are
    noise `alone`; elsewhere they are the residual of a model.
    """

    rows: Array
    motion: Array
    alone: bool


def series_of(setting: Setting, record: Record, white: Array) -> list[Series]:
    """Return what does not repeat in the fitted samples of `white` (n, n_y)."""
    size = np.maximum(setting.data.u_scale(), np.finfo(float).tiny)
    motion = np.sum((record.u / size) ** 2, axis=1)
    out = []
    for w in record.windows:
        if w.held_out:
            continue
        start = max(w.start, setting.whitener.order)
        begin, count = w.repeated
        if count < 2:
            mask = np.zeros(record.n, dtype=bool)
            mask[start : w.stop] = True
            out += [Series(white[a:b], motion[a:b], False) for a, b in stretches_of(mask)]
            continue
        periods = white[begin : begin + count * w.period].reshape(count, w.period, -1)
        played = motion[begin : begin + w.period]
        out += [Series(np.tensordot(row, periods, axes=1), played, True) for row in scipy.linalg.helmert(count)]
    return out


def spectrum_of(setting: Setting, series: Sequence[Array]) -> Spectrum | None:
    """Return the residual's spectrum from whitened series (m, n_y); None when there is too little for one."""
    rate = setting.data.rate_hz
    parts, powers = [], []
    for x in series:
        f = np.arange(x.shape[0]) / (2.0 * x.shape[0])
        used = (f >= _CYCLES / (2.0 * x.shape[0])) & (f <= HIGHEST)
        parts.append(f[used])
        powers.append((scipy.fft.dct(x, axis=0, norm="ortho") ** 2)[used])
    frequency = np.concatenate(parts) if parts else np.zeros(0)
    if frequency.size < 32 * _LEAST_ROWS:
        return None
    line = np.exp(-2j * np.pi * np.outer(frequency, np.arange(setting.whitener.order + 1)))
    power = np.concatenate(powers) / np.abs(line @ setting.whitener.taps.T) ** 2
    ordered = np.sort(frequency)
    edges, at = [float(ordered[0])], 0
    while at + 2 * _LEAST_ROWS < ordered.size:
        at = max(at + _LEAST_ROWS, int(np.searchsorted(ordered, edges[-1] * _GROWTH)))
        if at + _LEAST_ROWS > ordered.size:
            break
        edges.append(float(ordered[at]))
    edges.append(float(np.nextafter(ordered[-1], np.inf)))
    low, high = np.array(edges[:-1]), np.array(edges[1:])
    band = band_of(np.array(edges), frequency)
    number = np.bincount(band, minlength=low.size)
    means = np.stack([np.bincount(band, p, low.size) / np.maximum(number, 1) for p in power.T])
    inside = (np.arange(5) + 0.5) / 5.0
    points = low[:, None] + (high - low)[:, None] * inside
    kept = number > 0
    return Spectrum(points[kept] * rate, means[:, kept], number[kept].astype(float))
