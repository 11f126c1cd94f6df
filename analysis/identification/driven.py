"""Which channels of records take part in an identification: inputs that move, and outputs that may answer one.

An input at rest leaves numbers that nothing determines, and an output that holds only noise has no response: fitted
with the others, they keep every step of the search from ending.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.identification.growth import DAMPING_RATIO, states_of_a_block
from analysis.identification.whitening import whitening_filters
from sim_backend.linear import Array

_CHANCE = 1e-3
"""How often an output that holds only noise may be taken for one that answers: it is then fitted for nothing."""

_NEAR = 100
"""Lines to either side over which the spectrum of noise changes little."""

_LEVEL = 1.0 + 3.0 / np.log(2.0) / np.sqrt(2.0 * _NEAR)
"""Ratio up to which the median of so many lines may be too low, to three standard deviations: 1 / (ln 2 √n) each."""

_RANK = 1e-9
"""Eigenvalue of the correlation of signals, relative to the largest, below which one adds nothing to the others."""


def answering(inputs: Sequence[Array], outputs: Sequence[Array], rate_hz: float) -> NDArray[np.bool_]:
    """Return which outputs (n_y,) of records (n, n_u) and (n, n_y) may answer the inputs, all of which move.

    Others hold nothing that any mode makes of the inputs, and no line stands out of their spectrum as a resonance or a
    free motion would. Of records too short to tell every output may answer, and so may a constant one, which is not
    noise but a fault.
    """
    constant = np.all([np.ptp(y, axis=0) == 0.0 for y in outputs], axis=0)
    may = constant | [_stands_out([y[:, o] for y in outputs]) for o in range(constant.size)]
    for o in np.flatnonzero(~may):
        may[o] = _follows(inputs, [y[:, o] for y in outputs], rate_hz)
    return may


def _follows(inputs: Sequence[Array], output: Sequence[Array], rate_hz: float) -> bool:
    """Tell whether a mode of any frequency, driven by the inputs, explains some of an output; by F tests.

    Modes are as far apart as they are wide. One far above what is played acts as a gain.
    """
    own = [y[:, None] - y.mean() for y in output]
    taps = whitening_filters(own, None)[0]
    white = np.concatenate([_filtered(taps, y)[:, 0] for y in own])
    slowest = rate_hz / max(y.size for y in output)
    count = int(np.log(0.5 * rate_hz / slowest) / np.log1p(2.0 * DAMPING_RATIO)) + 1
    best = 1.0
    for frequency_hz in np.geomspace(slowest, 0.5 * rate_hz, count):
        states = [states_of_a_block(2.0 * np.pi * frequency_hz, u, rate_hz) for u in inputs]
        columns = np.concatenate([_filtered(taps, x - x.mean(axis=0)) for x in states])
        best = min(best, _chance(columns, white))
    return best * count < _CHANCE


def _chance(columns: Array, white: Array) -> float:
    """Return the chance at which signals (n, k) explain as much of a `white` one (n,) as they do."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0.0] / size[size > 0.0]
    values, vectors = np.linalg.eigh(columns.T @ columns)
    known = values > _RANK * values.max(initial=0.0)
    part = float(np.sum((vectors[:, known].T @ (columns.T @ white)) ** 2 / values[known]))
    tests, free = int(known.sum()), white.size - int(known.sum())
    if not tests or free < 1:
        return 1.0
    left = max(float(white @ white) - part, np.finfo(float).tiny)
    return float(scipy.special.fdtrc(tests, free, part / tests / (left / free)))


def _filtered(taps: Array, signals: Array) -> Array:
    """Return signals (n, c) filtered by `taps` (p + 1,), without the first samples, whose past is not known."""
    return np.asarray(scipy.signal.lfilter(taps, [1.0], signals, axis=0)[taps.size - 1 :])


def _stands_out(output: Sequence[Array]) -> bool:
    """Tell whether the spectrum of an output (n,) has a line that noise of a smooth spectrum does not have."""
    for y in output:
        power = np.abs(scipy.fft.rfft(y - y.mean()))[1 : (y.size + 1) // 2] ** 2
        if power.size < _NEAR:
            return True
        # of complex Gaussian noise the power of a line is exponential, and its median is ln 2 of the mean
        near = scipy.ndimage.median_filter(power, 2 * _NEAR + 1, mode="reflect") / np.log(2.0)
        if np.max(power / np.maximum(near, np.finfo(float).tiny)) > _LEVEL * np.log(power.size / _CHANCE):
            return True
    return False
