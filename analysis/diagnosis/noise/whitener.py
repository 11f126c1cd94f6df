"""The whitener: what makes independent numbers of unit variance of a residual.

Whitening by the inverse of an autoregressive model turns coloured measurement noise, unmeasured torques and the
random walk of rigid axes alike into independent numbers of unit variance, so that sums of squares are likelihoods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from campaigns.facts.base import stretches_of
from sim_backend.jit import njit
from sim_backend.linear import Array

Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]

_STEEPEST = 2.0
"""Steepest rise of noise towards low frequencies that is thought possible: a random walk's power."""

_SLOPE_BANDS = 4
"""Bands that show how noise rises below the lowest: one of a dozen coefficients knows its level to a factor of two."""

_SAME_EDGE = 1e-9
"""Edges (cycles per sample) that are no farther apart than this are one."""

TOGETHER = 16
"""Columns that are whitened at a time."""


@dataclass(frozen=True)
class Bands:
    """Levels (n_y, k) of a noise, in units of the filtered one, between `edges` (k + 1,) in cycles per sample."""

    edges: Array
    levels: Array

    def at(self, frequency: Array) -> Array:
        """Return the levels (n_y, n) at every `frequency` (n,), one outside all bands."""
        band = band_of(self.edges, frequency)
        known = (band >= 0) & (band < self.levels.shape[1])
        found = np.ones((self.levels.shape[0], frequency.size))
        found[:, known] = self.levels[:, band[known]]
        return found


@dataclass(frozen=True)
class Whitener:
    """Per output an inverse filter, `taps` (n_y, order + 1) with first tap 1/sd.

    `repeats` is True when the noise was estimated from what differs between equal periods, so that its size is known
    apart from any error of the model. `edges` (k + 1,) in cycles per sample and `levels` (n_y, k) say how much stronger
    than white the filtered noise still is in the bands that the filter is too short for. The lowest `guessed` of them
    are below what differences of periods show: their levels contain whatever the residual has there. With `even` above
    zero all samples and frequencies of an output have equal weight, in units of the residual itself: then the error is
    weighed, not the noise, and `even` is the noise in that unit.
    """

    taps: Array
    repeats: bool
    edges: Array = field(default_factory=lambda: np.zeros(1))
    levels: Array = field(default_factory=lambda: np.zeros((0, 0)))
    even: float = 0.0
    guessed: int = 0

    @property
    def bands(self) -> Bands:
        """The levels with their edges; one everywhere where there are none."""
        return Bands(self.edges, self.levels.reshape(len(self.outputs), -1))

    def flat(self) -> Whitener:
        """Return the whitener of a noise that rises no further where nothing but the residual tells that it does."""
        levels = self.levels.copy()
        levels[:, : self.guessed] = levels[:, [self.guessed]] if self.guessed else 0.0
        return replace(self, levels=levels)

    def with_bands(self, bands: Bands) -> Whitener:
        """Return the whitener of a noise that is at least as strong as `bands` say wherever they lie.

        The lowest bands keep their edges: their slope tells how noise rises below them, and some may be guessed.
        """
        first = self.edges[min(max(_SLOPE_BANDS, self.guessed), self.edges.size - 1)]
        apart = np.min(np.abs(bands.edges[:, None] - self.edges), axis=1) > _SAME_EDGE
        edges = np.unique(np.concatenate([self.edges, bands.edges[(bands.edges > first) & apart]]))
        middle = 0.5 * (edges[:-1] + edges[1:])
        return replace(self, edges=edges, levels=np.maximum(self.bands.at(middle), bands.at(middle)))

    def band_levels(self, n: int, output: int) -> Array:
        """Return the levels (k,) of the lowest of `n` cosine coefficients, as many as lie in bands.

        Below the middle of the lowest band the noise is extrapolated as it rose over the lowest few: noise that is
        coloured there is strongest where it is least visible, and an offset would be taken for physics. Where nothing
        repeats, the levels also contain the residual of an effect, and their slope says nothing of the noise.
        """
        if (n, output) not in self._by_length:
            self._by_length[n, output] = self._levels_of(n, output)
        return self._by_length[n, output]

    @cached_property
    def _by_length(self) -> dict[tuple[int, int], Array]:
        """Every fit asks for the same few lengths thousands of times."""
        return {}

    def _levels_of(self, n: int, output: int) -> Array:
        frequency = np.arange(n) / (2.0 * n)
        band = band_of(self.edges, frequency)
        count = int(np.searchsorted(band, self.levels.shape[1]))  # bands rise with frequency
        # a record of two periods has too few coefficients for a band below two bins: they are as loud as the next
        levels = self.levels[output][np.maximum(band[:count], 0)]
        if self.levels.shape[1] < 2 or not self.repeats:
            return levels
        centres = 0.5 * (self.edges[:-1] + self.edges[1:])[:_SLOPE_BANDS]
        first, heights = centres[0], np.log(self.levels[output, : centres.size])
        slope = float(np.clip(-np.polyfit(np.log(centres), heights, 1)[0], 0.0, _STEEPEST))
        below = frequency[:count] < first
        return np.asarray(levels * np.where(below, first / np.maximum(frequency[:count], 0.25 / n), 1.0) ** slope)

    @property
    def order(self) -> int:
        """Length of the filter's memory in samples."""
        return int(self.taps.shape[1]) - 1

    @property
    def outputs(self) -> range:
        """Numbers of the outputs."""
        return range(self.taps.shape[0])

    def apply(self, values: Array, output: int) -> Array:
        """Return `values` (n, k) of one output, whitened, same shape; their first samples have fewer before them."""
        return np.asarray(self._filtered(values.T, output).T)

    def _filtered(self, series: Array, output: int) -> Array:
        """Return `series` (k, n), whitened, same shape; time runs along the rows."""
        series = np.ascontiguousarray(series)
        out = filtered(self.taps[output], series)
        begin = self._beginnings[output][: series.shape[1], : series.shape[1]]
        out[:, : begin.shape[0]] = series[:, : begin.shape[0]] @ begin.T
        return out

    @cached_property
    def _beginnings(self) -> list[Array]:
        """What whitens the first samples of a series of each output, as many as the order: (order, order)."""
        return [beginning(taps) for taps in self.taps]

    def rows(self, values: Array, mask: Mask, output: int) -> Array:
        """Return the masked samples of `values` (n, k) as independent numbers of unit variance, shape (rows, k).

        Each unbroken run of samples is transformed to the cosine basis, where a band's level is a plain factor. A few
        columns are filtered at a time, so that only the result takes memory beside `values`.
        """
        out = np.empty((values.shape[1], int(mask.sum())))
        self.fill_rows(values.T, mask, output, out)
        return out.T

    def fill_rows(self, series: Array, mask: Mask, output: int, out: Array) -> None:
        """Fill `out` (k, rows) with the rows of `series` (k, n), time along the rows of both."""
        runs = stretches_of(mask)
        factors = [np.sqrt(self.band_levels(stop - start, output)) for start, stop in runs] if self.levels.size else []
        for some in range(0, series.shape[0], TOGETHER):
            white, first = self._filtered(series[some : some + TOGETHER], output), 0
            kept = out[some : some + TOGETHER]
            for k, (start, stop) in enumerate(runs):
                part = white[:, start:stop]
                if factors:
                    part = scipy.fft.dct(part, axis=1, norm="ortho", overwrite_x=True)
                    part[:, : factors[k].size] /= factors[k]
                kept[:, first : first + stop - start] = part
                first += stop - start

    def band_of_rows(self, mask: Mask) -> Ints:
        """Return the band (rows,) of each coefficient that `rows` returns, -1 above all bands or without any."""
        band = band_of(self.edges, frequency_of_rows(mask))
        return np.asarray(np.where(band < self.levels.shape[1], band, -1))

    def log_variance(self, mask: Mask) -> float:
        """Return the sum of the logarithms of the variances by which the samples of a mask (n,) are divided."""
        total = -2.0 * int(mask.sum()) * float(np.sum(np.log(self.taps[:, 0])))
        for taps, begin in zip(self.taps, self._beginnings, strict=True):
            own = np.diag(begin)[: mask.size]
            known = mask[: own.size] & (own > 0.0)
            total += 2.0 * float(np.sum(np.log(taps[0] / own[known])))
        if not self.levels.size:
            return total
        for start, stop in stretches_of(mask):
            total += sum(float(np.sum(np.log(self.band_levels(stop - start, o)))) for o in self.outputs)
        return total


def frequency_of_rows(mask: Mask, least: float = 0.0) -> Array:
    """Return the frequency (rows,) of each coefficient that a whitener makes of a mask (n,), in cycles per sample.

    It is `least` bins at least. The first coefficient of an unbroken run is its mean, each further one is half a
    frequency bin higher.
    """
    counts = (stop - start for start, stop in stretches_of(mask))
    return np.concatenate([np.zeros(0), *(np.maximum(np.arange(n) / 2.0, least) / n for n in counts)])


def louder(whitener: Whitener, added: Sequence[Bands]) -> Whitener:
    """Return the whitener of a noise that is at least as strong as all of `added`."""
    for bands in added:
        whitener = whitener.with_bands(bands)
    return whitener


def band_of(edges: Array, frequency: Array) -> Ints:
    """Return which band between `edges` (k + 1,) holds each `frequency` (n,); -1 below all, k or more above."""
    return np.asarray(np.searchsorted(edges, frequency, side="right") - 1)


def beginning(taps: Array) -> Array:
    """Return the matrix (order, order) that whitens the first samples of a series of the noise that `taps` whiten.

    The noise existed before the first sample and is as strong in it as anywhere: the first sample has the whole
    variance, the next only what the one before does not predict, and so on (Levinson's recursion, run backwards). A
    filter run from zeros would take the first samples, and with them an offset, as known as exactly as the innovations.
    Samples of which nothing is known have no weight: those of an order whose noise grows without bound.
    """
    out = np.zeros((taps.size - 1, taps.size - 1))
    weights, scale = taps / taps[0], taps[0]
    for m in range(taps.size - 1, 0, -1):
        left = 1.0 - weights[m] ** 2
        if not left > 0.0:
            break
        weights = (weights[:m] - weights[m] * weights[m:0:-1]) / left
        scale *= np.sqrt(left)
        out[m - 1, :m] = scale * weights[::-1]
    return out


def filtered(taps: Array, series: Array) -> Array:
    """Return each row of `series` (k, n) filtered by `taps` from zeros, same shape."""
    out = np.empty(series.shape)
    _fir(taps, np.ascontiguousarray(series), out)
    return out


@njit
def _fir(taps, series, out):  # type: ignore[no-untyped-def]
    """Fill `out` (k, n) with each row of `series` filtered by `taps`; stretches of it stay in the fastest memory.

    Slices, because an index that might be negative keeps a loop from being vectorised: four times as fast.
    """
    k, n = series.shape
    for j in range(k):
        for first in range(0, n, 2048):
            last = min(first + 2048, n)
            past, now = series[j, first:last], out[j, first:last]
            for i in range(now.size):  # one by one: see `analysis.linear.simulate._add_direct`
                now[i] = taps[0] * past[i]
            for lag in range(1, taps.size):
                begin, w = max(first, lag), taps[lag]
                past, now = series[j, begin - lag : last - lag], out[j, begin:last]
                for i in range(now.size):
                    now[i] += w * past[i]
