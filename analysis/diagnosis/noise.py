"""The noise that everything is measured against.

Its colour comes from autoregression, its size from what does not repeat, or else from what is left.

Whitening by the inverse of an autoregressive model turns coloured measurement noise, unmeasured torques and the
random walk of rigid axes alike into independent numbers of unit variance, so that sums of squares are likelihoods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.fft import dct

from analysis.diagnosis.dataset import Dataset

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]

_MAX_ORDER = 40
BAND_ROWS, _MAX_BANDS = 12, 24
_KNOWN_ROWS = 24
"""The mean square of so many normal numbers is known to 30 %."""

_STEEPEST = 2.0
"""Steepest rise of noise towards low frequencies that is thought possible: a random walk's power."""

_SLOPE_BANDS = 4
"""Bands that tell how noise rises below the lowest: of a dozen rows, one knows its level to a factor of two."""

_SAME_EDGE = 1e-9
"""Edges (cycles per sample) that are no farther apart than this are one."""

_GROWTH = 1.5
"""Ratio of a band's edges: spectra of noise are smooth on a logarithmic scale, and high bands hold rows enough."""
_MEDIAN_OF_SQUARE = 0.4549
"""Median of the square of a standard normal number."""


@dataclass(frozen=True)
class Bands:
    """Levels (n_y, k) of a noise, in units of the filtered one, between `edges` (k + 1,) in cycles per sample."""

    edges: Array
    levels: Array

    def at(self, frequency: Array) -> Array:
        """Return the levels (n_y, n) at every `frequency` (n,), one outside all bands."""
        band = np.searchsorted(self.edges, frequency, side="right") - 1
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
    lie below what differences of periods show: their levels hold whatever the residual does there. With `even` above
    zero every row and frequency of an output weighs alike, in units of the residual itself: the error, not the noise,
    is then what is weighed, and `even` is the noise in that unit.
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
        """Return the levels of the lowest rows of a cosine basis of `n`, as many as lie in bands.

        Below the middle of the lowest band the noise goes on rising as it did over the lowest few: noise that is
        coloured down there is strongest where one can see least of it, and an offset would be taken for physics.
        Where nothing repeats, the levels hold what an effect leaves as well, and their slope says nothing of the noise.
        """
        frequency = np.arange(n) / (2.0 * n)
        band = np.searchsorted(self.edges, frequency, side="right") - 1
        count = int(np.searchsorted(band, self.levels.shape[1]))  # bands rise with frequency
        levels = self.levels[output][band[:count]]
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
        """Return `values` (n, k) of one output, whitened, same shape; the start is filtered from zeros."""
        return np.asarray(self._filtered(values, output).T)

    def _filtered(self, values: Array, output: int) -> Array:
        """Return `values` (n, k), whitened, with time along the rows: (k, n)."""
        series = np.ascontiguousarray(values.T)
        out = np.empty_like(series)
        _fir(self.taps[output], series, out)
        return out

    def rows(self, values: Array, mask: Mask, output: int) -> Array:
        """Return the masked rows of `values` (n, k) as independent numbers of unit variance, shape (rows, k).

        Each unbroken run of rows is taken into the cosine basis, where a band's level is a plain factor.
        """
        white = self._filtered(values, output)
        if not self.levels.size:
            return np.asarray(white[:, mask].T)
        parts = []
        for start, stop in runs_of(mask):
            spectrum = dct(white[:, start:stop], axis=1, norm="ortho", overwrite_x=True)
            levels = self.band_levels(stop - start, output)
            spectrum[:, : levels.size] /= np.sqrt(levels)
            parts.append(spectrum)
        return np.asarray((np.concatenate(parts, axis=1) if parts else white[:, mask]).T)

    def band_of_rows(self, mask: Mask) -> Ints:
        """Return the band of each of the rows that `rows` returns, -1 above all bands or where there are none."""
        parts = [np.zeros(0), *(np.arange(n) / (2.0 * n) for n in (stop - start for start, stop in runs_of(mask)))]
        band = np.searchsorted(self.edges, np.concatenate(parts), side="right") - 1
        return np.asarray(np.where(band < self.levels.shape[1], band, -1))

    def log_variance(self, mask: Mask) -> float:
        """Return the sum of the logarithms of the variances by which the masked rows of a record are divided."""
        total = -2.0 * int(mask.sum()) * float(np.sum(np.log(self.taps[:, 0])))
        if not self.levels.size:
            return total
        for start, stop in runs_of(mask):
            total += sum(float(np.sum(np.log(self.band_levels(stop - start, o)))) for o in self.outputs)
        return total


def louder(whitener: Whitener, added: Sequence[Bands]) -> Whitener:
    """Return the whitener of a noise that is at least as strong as all of `added`."""
    for bands in added:
        whitener = whitener.with_bands(bands)
    return whitener


def runs_of(mask: Mask) -> list[tuple[int, int]]:
    """Return (start, stop) of every unbroken run of set rows."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


@njit(cache=True, nogil=True)
def _fir(taps, series, out):  # type: ignore[no-untyped-def]
    """Fill `out` (k, n) with each row of `series` filtered by `taps`; stretches of it stay in the fastest memory.

    Slices, because an index that might be negative keeps a loop from being vectorised: four times as fast.
    """
    k, n = series.shape
    for j in range(k):
        for first in range(0, n, 2048):
            last = min(first + 2048, n)
            out[j, first:last] = taps[0] * series[j, first:last]
            for lag in range(1, taps.size):
                begin, w = max(first, lag), taps[lag]
                past, now = series[j, begin - lag : last - lag], out[j, begin:last]
                for i in range(now.size):
                    now[i] += w * past[i]


def fit_ar(parts: list[tuple[Array, Mask]], max_order: int = _MAX_ORDER) -> Array:
    """Return the whitening taps (order + 1,) of the series (n,) in `parts`, using rows whose mask is set.

    Least squares over all rows at once (covariance method, which also suits near-unit roots), order by BIC; the first
    tap is the inverse of the innovations' standard deviation.
    """
    p = max(min(max_order, min(x.size for x, _ in parts) // 10), 0)
    normal = np.zeros((p + 1, p + 1))
    rows = 0
    for x, mask in parts:
        if x.size <= p or not np.any(x):
            continue
        lags = np.lib.stride_tricks.sliding_window_view(x, p + 1)[mask[p:]][:, ::-1]
        normal += lags.T @ lags
        rows += lags.shape[0]
    best, best_score = np.ones(1), np.inf
    for order in range(p + 1):
        inner = normal[1 : order + 1, 1 : order + 1]
        ridge = 1e-12 * np.trace(inner) / max(order, 1)
        if rows == 0:
            break
        weights = np.linalg.solve(inner + ridge * np.eye(order), normal[1 : order + 1, 0]) if order else np.zeros(0)
        rss = float(normal[0, 0] - weights @ normal[1 : order + 1, 0])
        if rss <= 0.0:
            continue
        score = rows * np.log(rss / rows) + order * np.log(rows)
        if score < best_score - 1e-9:
            best_score = score
            best = np.concatenate([[1.0], -weights]) / np.sqrt(rss / rows)
    return best


def whitener_from(data: Dataset, residuals: list[Array], *, order: int | None = None) -> Whitener:
    """Return the whitener of `residuals`, one (n, n_y) per record, from what differs between periods.

    Otherwise the colour and size of the residuals themselves are used. `order` is the longest memory of the filter.
    """
    taps: list[Array] = []
    repeats = any(w.period and w.stop - w.start >= 2 * w.period for r in data.records for w in r.windows)
    for o in range(data.n_outputs):
        parts = []
        for record, residual in zip(data.records, residuals, strict=True):
            if repeats:
                parts += _differences(record.windows, residual[:, o])
            else:
                parts.append((residual[:, o], record.fitted()))
        taps.append(fit_ar(parts, _MAX_ORDER if order is None else order))
    longest = max(t.size for t in taps)
    plain = Whitener(np.stack([np.pad(t, (0, longest - t.size)) for t in taps]), repeats)
    return plain if order == 0 else _with_levels(plain, data, residuals)


def above_noise(data: Dataset, residuals: Sequence[Array]) -> float:
    """Return the largest ratio, over the outputs, of the rms residual to the rms noise; zero where nothing repeats."""
    ratios = [0.0]
    for o in range(data.n_outputs):
        noise = [x for r, e in zip(data.records, residuals, strict=True) for x, _ in _differences(r.windows, e[:, o])]
        whole = [e[r.fitted(), o] for r, e in zip(data.records, residuals, strict=True)]
        if noise:
            floor = max(float(np.std(np.concatenate(noise))), np.finfo(float).tiny)
            ratios.append(float(np.std(np.concatenate(whole))) / floor)
    return max(ratios)


def even_weights(data: Dataset, residuals: Sequence[Array], noise: float) -> Whitener:
    """Return the whitener that only scales every output by the rms of its `residuals`, one (n, n_y) per record.

    `noise` is that of the noise, in the same unit.

    Where an error of the model is many times the noise, the noise says nothing of what is worth explaining: its quiet
    bands would decide, in which the error is smallest.
    """
    parts = [
        record.weight * residual[record.fitted()] for record, residual in zip(data.records, residuals, strict=True)
    ]
    rms = np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0))
    return Whitener(1.0 / np.maximum(rms, np.finfo(float).tiny)[:, None], False, even=noise)


def rows_of_noise(data: Dataset) -> int:
    """Return how many rows, over all outputs, differences of periods show of noise alone."""
    parts = [_differences(r.windows, np.zeros(r.n)) for r in data.records]
    return data.n_outputs * sum(x.size for found in parts for x, _ in found)


def _with_levels(plain: Whitener, data: Dataset, residuals: list[Array]) -> Whitener:
    """Return the whitener with the levels of low bands, for which its filter is too short.

    Below two lines of the period, where differences of periods see nothing, levels are medians of the residual, so
    that the lines of a periodic excitation, where an error of the model stands, do not count as noise. Above, where
    there are differences, levels are their means: they hold noise alone.
    """
    periods = [w.period for r in data.records for w in r.windows if w.period]
    highest = min(2.0 / min(periods) if plain.repeats and periods else 0.5 / max(plain.order, 1), 0.25)
    whole = [
        [(r[:, o], record.fitted()) for record, r in zip(data.records, residuals, strict=True)] for o in plain.outputs
    ]
    edges, levels = _levels([_powers(plain, parts, o) for o, parts in enumerate(whole)], highest)
    if not plain.repeats:
        return Whitener(plain.taps, False, edges, levels)
    repeated = [
        [
            part
            for record, r in zip(data.records, residuals, strict=True)
            for part in _differences(record.windows, r[:, o])
        ]
        for o in plain.outputs
    ]
    more, upper = _repeated_levels([_powers(plain, parts, o) for o, parts in enumerate(repeated)], highest)
    if edges.size < 2:
        edges, levels = np.array([highest]), np.ones((len(repeated), 0))
    # noise does not fall towards low frequencies, so what few rows show of it is no less than what is known above them
    levels = np.maximum(levels, upper[:, :1])
    joined = np.concatenate([levels, upper], axis=1)
    return Whitener(plain.taps, True, np.concatenate([edges, more]), joined, guessed=levels.shape[1])


def _powers(plain: Whitener, parts: list[tuple[Array, Mask]], output: int) -> tuple[Array, Array]:
    """Return frequency (cycles per sample) and power of all rows of the whitened series in `parts`."""
    frequency, power = [np.zeros(0)], [np.zeros(0)]
    for x, mask in parts:
        white = plain.apply(x[:, None], output)[:, 0]
        for start, stop in runs_of(mask):
            power.append(dct(white[start:stop], norm="ortho") ** 2)
            frequency.append(np.arange(stop - start) / (2.0 * (stop - start)))
    return np.concatenate(frequency), np.concatenate(power)


def _levels(spectra: list[tuple[Array, Array]], highest: float) -> tuple[Array, Array]:
    """Return edges and levels of the bands below `highest` from medians; nothing where there are too few rows."""
    below = np.sort(spectra[0][0][spectra[0][0] < highest])
    count = min(below.size // BAND_ROWS, _MAX_BANDS)
    if count < 1:
        return np.zeros(1), np.zeros((len(spectra), 0))
    # bands hold growing numbers of rows, so that they are narrow where the level changes fast
    share = np.linspace(0.0, 1.0, count + 1) ** 2
    at = np.unique(np.maximum((share * below.size).astype(int), BAND_ROWS * np.arange(count + 1)))
    edges = np.append(below[np.minimum(at[:-1], below.size - 1)], highest)
    levels = np.ones((len(spectra), edges.size - 1))
    for o, (frequency, power) in enumerate(spectra):
        band = np.searchsorted(edges, frequency, side="right") - 1
        for b in range(edges.size - 1):
            inside = power[band == b]
            if inside.size:
                levels[o, b] = max(1.0, float(np.median(inside)) / _MEDIAN_OF_SQUARE)
    return edges, levels


def _repeated_levels(spectra: list[tuple[Array, Array]], lowest: float) -> tuple[Array, Array]:
    """Return upper edges and levels of the bands above `lowest`, each wide enough for its mean."""
    frequency = np.sort(spectra[0][0][spectra[0][0] >= lowest])
    edges, at = [lowest], 0
    while frequency.size - at >= 2 * _KNOWN_ROWS:
        at = max(at + _KNOWN_ROWS, int(np.searchsorted(frequency, _GROWTH * edges[-1])))
        if at >= frequency.size - _KNOWN_ROWS:
            break
        edges.append(float(frequency[at]))
    edges.append(0.5)
    levels = np.ones((len(spectra), len(edges) - 1))
    for o, (f, power) in enumerate(spectra):
        band = np.searchsorted(edges, f, side="right") - 1
        for b in range(len(edges) - 1):
            inside = power[band == b]
            if inside.size >= _KNOWN_ROWS:
                levels[o, b] = float(inside.mean())
    return np.array(edges[1:]), levels


def _differences(windows, x: Array) -> list[tuple[Array, Mask]]:  # type: ignore[no-untyped-def]
    """Return the differences of consecutive periods over √2: noise alone, of the same colour and size.

    With three periods or more the first difference is left out, which holds what is left of the transient.
    """
    parts = []
    for w in windows:
        whole = (w.stop - w.start) // w.period if w.period else 0
        if whole < 2:
            continue
        first = w.period if whole >= 3 else 0
        stretch = x[w.start + first : w.start + whole * w.period]
        difference = (stretch[w.period :] - stretch[: -w.period]) / np.sqrt(2.0)
        parts.append((difference, np.ones(difference.size, dtype=bool)))
    return parts
