"""The noise of a data set: its colour by autoregression, its size from what does not repeat, or from the residual."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from analysis.diagnosis.noise.autoregression import MAX_ORDER, fit_ar
from analysis.diagnosis.noise.levels import held_by_few, levels_of_means, levels_of_medians, no_weaker
from analysis.diagnosis.noise.whitener import Mask, Whitener
from analysis.diagnosis.records.dataset import Dataset, Record
from campaigns.facts.base import stretches_of
from sim_backend.linear import Array

_TREND = 3
"""Degree of the trend removed from differences: below one and a half frequency bins, they contain no noise."""


def whitener_from(data: Dataset, residuals: list[Array], *, order: int | None = None) -> Whitener:
    """Return the whitener of `residuals`, one (n, n_y) per record, from what differs between periods.

    Otherwise the colour and size of the residuals themselves are used. `order` is the longest memory of the filter.
    """
    taps: list[Array] = []
    for o in range(data.n_outputs):
        parts = []
        for record, residual in zip(data.records, residuals, strict=True):
            if data.repeats:
                parts += _differences(data, record, residual[:, o])
            else:
                parts.append((residual[:, o], record.fitted()))
        taps.append(fit_ar(parts, MAX_ORDER if order is None else order))
    longest = max(t.size for t in taps)
    plain = Whitener(np.stack([np.pad(t, (0, longest - t.size)) for t in taps]), data.repeats)
    return plain if order == 0 else _with_levels(plain, data, residuals)


def above_noise(data: Dataset, residuals: Sequence[Array]) -> float:
    """Return the largest ratio, over the outputs, of the rms residual to the rms noise; zero where nothing repeats.

    `residuals` are (n, n_y) per record.
    """
    ratios = [0.0]
    for o in range(data.n_outputs):
        noise = [x for r, e in zip(data.records, residuals, strict=True) for x, _ in _differences(data, r, e[:, o])]
        whole = [e[r.fitted(), o] for r, e in zip(data.records, residuals, strict=True)]
        if noise:
            floor = max(float(np.std(np.concatenate(noise))), np.finfo(float).tiny)
            ratios.append(float(np.std(np.concatenate(whole))) / floor)
    return max(ratios)


def even_weights(data: Dataset, residuals: Sequence[Array], noise: float) -> Whitener:
    """Return the whitener that only scales every output by the rms of its `residuals`, one (n, n_y) per record.

    `noise` is the rms of the noise in units of that residual.

    Where an error of the model is many times the noise, the noise says nothing of what is worth explaining: its quiet
    bands would decide, in which the error is smallest.
    """
    parts = [
        record.weight * residual[record.fitted()] for record, residual in zip(data.records, residuals, strict=True)
    ]
    rms = np.sqrt(np.mean(np.concatenate(parts) ** 2, axis=0))
    return Whitener(1.0 / np.maximum(rms, np.finfo(float).tiny)[:, None], False, even=noise)


def _with_levels(plain: Whitener, data: Dataset, residuals: list[Array]) -> Whitener:
    """Return the whitener with the levels of low bands, for which its filter is too short.

    Below two frequency bins of the period, where differences of periods contain nothing, levels are medians of the
    residual, so that the excited bins of a periodic excitation, which contain the error of the model, do not count as
    noise. Above, where there are differences, levels are their means: they contain noise alone.
    """
    periods = [w.period for r in data.records for w in r.windows if w.period]
    highest = min(2.0 / min(periods) if plain.repeats and periods else 0.5 / max(plain.order, 1), 0.25)
    whole = [
        [(r[:, o], record.fitted()) for record, r in zip(data.records, residuals, strict=True)] for o in plain.outputs
    ]
    left = [_powers(plain, parts, o) for o, parts in enumerate(whole)]
    edges, levels = levels_of_medians(left, highest)
    if not plain.repeats:
        few = [o for o in plain.outputs if held_by_few(left[o], highest)]
        weak = {o: no_weaker(edges, levels[o], plain.taps[o]) for o in few}
        return Whitener(
            plain.taps, False, edges, np.stack([weak.get(o, np.maximum(levels[o], 1.0)) for o in plain.outputs])
        )
    levels = np.maximum(levels, 1.0)
    repeated = [
        [
            part
            for record, r in zip(data.records, residuals, strict=True)
            for part in _differences(data, record, r[:, o])
        ]
        for o in plain.outputs
    ]
    more, upper = levels_of_means([_powers(plain, parts, o) for o, parts in enumerate(repeated)], highest, left)
    if edges.size < 2:
        edges, levels = np.array([highest]), np.ones((len(repeated), 0))
    # noise does not fall towards low frequencies, so its level in few coefficients is no less than the known one above
    levels = np.maximum(levels, upper[:, :1])
    joined = np.concatenate([levels, upper], axis=1)
    return Whitener(plain.taps, True, np.concatenate([edges, more]), joined, guessed=levels.shape[1])


def _powers(plain: Whitener, parts: list[tuple[Array, Mask]], output: int) -> tuple[Array, Array]:
    """Return frequency (cycles per sample) and power of all coefficients of the whitened series in `parts`."""
    frequency, power = [np.zeros(0)], [np.zeros(0)]
    for x, mask in parts:
        white = plain.apply(x[:, None], output)[:, 0]
        for start, stop in stretches_of(mask):
            power.append(scipy.fft.dct(white[start:stop], norm="ortho") ** 2)
            frequency.append(np.arange(stop - start) / (2.0 * (stop - start)))
    return np.concatenate(frequency), np.concatenate(power)


def _differences(data: Dataset, record: Record, x: Array) -> list[tuple[Array, Mask]]:
    """Return the differences of consecutive periods over √2: noise alone, of the same colour and size."""
    parts = []
    for w in record.windows:
        begin, count = w.repeated
        if count < 2:
            continue
        stretch = x[begin : begin + count * w.period]
        difference = (stretch[w.period :] - stretch[: -w.period]) / np.sqrt(2.0)
        if data.integrating:
            difference = _without_trend(difference)
        parts.append((difference, np.ones(difference.size, dtype=bool)))
    return parts


def _without_trend(x: Array) -> Array:
    """Return a difference (n,) of periods without the cubic that runs through it best.

    What a model gets wrong of a force on a free axis is integrated twice, and grows from period to period. It is not
    noise; a filter that took it for noise would differentiate, and nothing slow would count any more.
    """
    at = np.linspace(-1.0, 1.0, x.size)
    trend = np.polynomial.legendre.legfit(at, x, _TREND)
    return np.asarray(x - np.polynomial.legendre.legval(at, trend))
