"""The residual through the adjoint plant: the change of every sample of an input that it implies.

The gain of a small change of an input is its inner product with this, so that thousands of changes can be compared with
the residual without simulating any of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import response
from campaigns.facts.base import stretches_of
from sim_backend.linear import Array, ModalModel, discretise, played

Mask = NDArray[np.bool_]

_LONGEST = 20_000
"""Samples after which the response to one sample is taken to be over."""


def wanted_inputs(setting: Setting, linear: ModalModel, residuals: Sequence[Array]) -> tuple[list[Array], list[Array]]:
    """Return per input the gradient of the log-likelihood by its samples, all records joined, and one sample's answer.

    `residuals` are one (n, n_y) per record. The gradient is zero outside the samples that are fitted; the answer
    (rows, n_y) is what one unit at one sample makes of the readings, whitened; it may begin before that sample.
    """
    model = played(linear, setting.data.rate_hz)
    whitener = setting.whitener
    wanted: list[Array] = []
    for j in range(linear.n_inputs):
        parts = []
        for record, residual in zip(setting.data.records, residuals, strict=True):
            fitted = record.fitted()
            total = np.zeros(record.n)
            for o in whitener.outputs:
                white = _levelled(whitener, whitener.apply(residual[:, o, None], o)[:, 0], fitted, o)
                back = np.ascontiguousarray(whitener.apply(white[::-1, None], o)[:, 0])
                total += response(model, back, j, through_delay=True)[::-1, o]
            parts.append(np.where(fitted, total, 0.0))
        wanted.append(np.concatenate(parts))
    return wanted, [_answer(setting, linear, j) for j in range(linear.n_inputs)]


def _levelled(whitener: Whitener, white: Array, mask: Mask, output: int) -> Array:
    """Return filtered values (n,) divided by the noise's levels in its low bands, zero outside the mask."""
    out = np.zeros(white.size)
    for start, stop in stretches_of(mask):
        spectrum = scipy.fft.dct(white[start:stop], norm="ortho")
        if whitener.levels.size:
            levels = whitener.band_levels(spectrum.shape[0], output)
            spectrum[: levels.size] /= levels
        out[start:stop] = scipy.fft.idct(spectrum, norm="ortho")
    return out


def _answer(setting: Setting, linear: ModalModel, j: int) -> Array:
    pulse = np.zeros(min(max(r.n for r in setting.data.records), _LONGEST))
    pulse[0] = 1.0
    moved = response(discretise(linear, setting.data.rate_hz), pulse, j)
    return np.hstack(
        [_even(setting.whitener, setting.whitener.apply(moved[:, o, None], o), o) for o in range(moved.shape[1])]
    )


def _even(whitener: Whitener, white: Array, output: int) -> Array:
    """Return a filtered answer (n, 1) divided by the roots of the noise's levels in its low bands, shape (2 n, 1).

    Without a delay, so that it begins before the change that it answers: the change is at sample n / 2.
    """
    n = white.shape[0]
    levels = np.ones(n)
    if whitener.levels.size:
        low = whitener.band_levels(n, output)
        levels[: low.size] = low
    spectrum = np.fft.rfft(white, 2 * n, axis=0)
    spectrum[:n] /= np.sqrt(levels)[:, None]
    return np.asarray(np.roll(np.fft.irfft(spectrum, axis=0), n // 2, axis=0))
