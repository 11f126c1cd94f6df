"""What part of a difference follows the drive by some linear law: no wrong linear form can explain the rest.

A lag, or a creep, of a form that nature does not share leaves an error H(f) times what the linear model answers to
each input, whatever H is, as long as it is smooth and the same at every level. A spring that stiffens, or free play,
answers with harmonics, with what two lines make together, and otherwise at another level: that is no H.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.fitting.fit import Setting
from analysis.diagnosis.noise.whitener import Whitener, runs_of
from analysis.diagnosis.nominal.responses import played, response
from analysis.diagnosis.records.dataset import Record
from sim_backend.linear import DiscreteModel, ModalModel

Array = NDArray[np.float64]
Spectrum = NDArray[np.complex128]

_STRIPES = 240
"""Stripes of equal ratio that the frequencies are sorted into; bands are made of them."""

_LINES_PER_NUMBER = 20.0
"""Lines of equal power that a band has at least for each number of H in it: of what follows nothing, one part in so
many seems to follow."""


def following_of(setting: Setting, linear: ModalModel, change: Sequence[Array]) -> Array:
    """Return for each output the part (n_y,) of the energy of `change` that follows the inputs by a linear law.

    `change` is one (n, n_y) per record; it and the answers of the `linear` model count in units of the noise. In every
    band H runs straight, as a complex number of the frequency, for each input. One where nothing changes.
    """
    n_y, n_u = setting.data.n_outputs, linear.n_inputs
    model = played(linear, setting.data.rate_hz)
    parts = setting.each(
        lambda record, values: _lines(setting.whitener, model, record, values), setting.data.records, list(change)
    )
    frequency = np.concatenate([f for f, _ in parts])
    lines = np.concatenate([spectra for _, spectra in parts])
    order = np.argsort(frequency, kind="stable")
    return np.array([_part(frequency[order], lines[order, o], 2 * n_u) for o in range(n_y)])


def _lines(whitener: Whitener, model: DiscreteModel, record: Record, change: Array) -> tuple[Array, Spectrum]:
    """Return the frequencies (m,) of a record's lines, in cycles per sample, and (m, n_y, 1 + n_u) of its spectra.

    The first are those of the change, then those of the answers to each input, all in units of the noise.
    """
    answers = [response(model, record.u[:, j], j, through_delay=True) for j in range(record.u.shape[1])]
    frequency: list[Array] = []
    spectra: list[Spectrum] = []
    for start, stop in runs_of(record.fitted()):
        n = stop - start
        taper = np.hanning(n)[:, None] * record.weight
        own = np.arange(1, n // 2)
        found = np.empty((own.size, change.shape[1], 1 + len(answers)), dtype=complex)
        for o in whitener.outputs:
            white = whitener.apply(np.stack([change[:, o], *(a[:, o] for a in answers)], axis=1), o)[start:stop]
            found[:, o] = np.fft.rfft(white * taper, axis=0)[own]
            levels = whitener.band_levels(n, o) if whitener.levels.size else np.zeros(0)
            low = 2 * own < levels.size
            found[low, o] /= np.sqrt(levels[2 * own[low]])[:, None]
        frequency.append(own / n)
        spectra.append(found)
    return np.concatenate(frequency), np.concatenate(spectra)


def _part(frequency: Array, lines: Spectrum, numbers: int) -> float:
    """Return the part of the first column of `lines` (m, 1 + n_u), by rising `frequency`, that follows the others."""
    total = float(np.sum(np.abs(lines[:, 0]) ** 2))
    if not total > 0.0:
        return 1.0
    powers = np.sum(np.abs(lines[:, 1:]) ** 2, axis=1)
    left = 0.0
    for first, last in _bands(frequency, powers, _LINES_PER_NUMBER * numbers):
        change, answers = lines[first:last, 0], lines[first:last, 1:]
        offset = frequency[first:last] - np.mean(frequency[first:last])
        columns = np.hstack([answers, answers * (offset / max(float(np.ptp(offset)), np.finfo(float).tiny))[:, None]])
        fitted = columns @ np.linalg.lstsq(columns, change, rcond=1e-9)[0]
        left += float(np.sum(np.abs(change - fitted) ** 2))
    return 1.0 - left / total


def _bands(frequency: Array, powers: Array, lines: float) -> list[tuple[int, int]]:
    """Return bands of lines (first, last), each with as many as `lines` of equal power would make, or all there are.

    Power is compared within a stripe only: it falls by orders of magnitude beyond a resonance, where lines count too.
    """
    edges = np.geomspace(frequency[0], frequency[-1] * (1.0 + 1e-9), _STRIPES + 1)
    stops = np.unique(np.searchsorted(frequency, edges[1:]))
    bands: list[tuple[int, int]] = []
    first, before, found = 0, 0, 0.0
    for stop in stops[stops > 0].tolist():
        own = powers[before:stop]
        found, before = found + float(own.sum()) ** 2 / max(float(own @ own), np.finfo(float).tiny), stop
        if found >= lines:
            bands.append((first, stop))
            first, found = stop, 0.0
    if first < frequency.size:
        # too few lines are left for a band of their own
        bands = [*bands[:-1], (bands[-1][0] if bands else 0, frequency.size)]
    return bands
