"""How much of what its effects explain a fit may get wrong by model discrepancy: the real effect has another law.

A lag, or a creep, whose law differs from the real one leaves an error H(f) times what the linear model answers to
each input, whatever H is, as long as it is smooth and the same at every level. A spring that stiffens, or free play,
answers with harmonics, with intermodulation, and differently at another level: that is not H. So the part of a
difference that follows the drive by some linear law bounds what a wrong linear law can explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.fitting.balance import squares_of
from analysis.diagnosis.fitting.fit import Fit, Setting, left_by, linear_of
from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import response
from analysis.diagnosis.nominal.tuning import turned
from analysis.diagnosis.records.dataset import Record
from campaigns.facts.base import stretches_of
from sim_backend.effects.base import Effect
from sim_backend.linear import Array, DiscreteModel, ModalModel, played

Spectrum = NDArray[np.complex128]

_LAW, _EXACT, _STEADY = 3e-3, 1e-4, 1e-6
"""Parts of what an effect explains that may be model discrepancy, or beyond the accuracy of a simulation in steps:
what explains less than that beside it is not searched for. A gain or a delay has only one law (`exact`), but holds to
1 % only. What is linear whatever its law (`linear_form`) is wrong by what follows the drive by a linear law: its
distortion is that of an amplifier or of a spring, a thousandth."""

_STRIPES = 240
"""Stripes of equal ratio that the frequencies are sorted into; bands are made of them."""

_LINES_PER_NUMBER = 20.0
"""Bins of equal power that a band has at least for each number of H in it: of a signal unrelated to the drive, one part
in so many seems to follow it."""


@dataclass(frozen=True)
class Discrepancy:
    """Model discrepancy as a sum of squares in units of the noise, in each of the readings at `outputs`.

    What an effect explains in one reading says nothing of how well another is understood. The part `linear` of `parts`
    is the discrepancy of linear effects.
    """

    outputs: tuple[str, ...]
    parts: tuple[float, ...]
    linear: tuple[float, ...] = ()

    @property
    def total(self) -> float:
        """In all readings together."""
        return sum(self.parts)

    def of(self, shares: Sequence[float] | Array) -> float:
        """Return it for what shows in the readings by these `shares` (n_y,) of its energy; in total for what has none.

        The discrepancy along a signature is limited in each reading to the part that the signature has there.
        """
        if len(shares) != len(self.parts) or not np.sum(shares) > 0.0:
            return self.total
        return float(np.dot(self.parts, shares))

    def along(self, following: Sequence[float] | Array) -> Discrepancy:
        """Return it for what follows the drive by a linear law in the parts `following` (n_y,) of its energy."""
        if not any(self.linear):
            return self
        rest = np.array(self.parts) - np.array(self.linear) * (1.0 - np.asarray(following))
        return Discrepancy(self.outputs, tuple(rest.tolist()))

    def at(self, where: str) -> float:
        """Return it in the reading of a location, in all of them where the location has none of its own."""
        target = target_of(where)
        return self.parts[self.outputs.index(target)] if target in self.outputs else self.total


def target_of(where: str) -> str:
    """Return the degree of freedom at which what acts at `where` is seen."""
    return where.rpartition("->")[2]


def form_error(effect: Effect, following: float = 1.0) -> float:
    """Return the model discrepancy as part of what an effect explains.

    `following` is the part of its energy that follows the drive by a linear law.
    """
    own = _EXACT if effect.exact else _LAW
    return _STEADY + (own - _STEADY) * following if effect.linear_form else own


def explained_by(setting: Setting, tuned: Fit, best: Fit) -> float:
    """Return by how much `best` lowers the sum of squares that `tuned` leaves, in units of the present noise."""
    if not best.candidates:
        return 0.0
    return max(float(np.sum(squares_of(setting, tuned.residuals))) - best.misfit, 0.0)


def beyond_form(setting: Setting, before: Fit, after: Fit, least: Discrepancy) -> bool:
    """Tell whether `after` explains more beside `before` than `least`, the model discrepancy there, allows.

    Where these are linear, the discrepancy is the part of the difference that follows the drive by a linear law.
    """
    change = _change(before, after)
    parts = following_of(setting, linear_of(setting, before), change)
    gained = float(np.sum(squares_of(setting, before.residuals))) + before.penalty - after.objective
    moved = squares_of(setting, change)
    return gained >= least.along(parts).of(moved / max(float(np.sum(moved)), np.finfo(float).tiny))


def following(setting: Setting, before: Fit, after: Fit, place: str) -> float:
    """Return the part of what `after` changes in the reading of a location that follows the drive by a linear law.

    The largest in any reading where the location has none of its own.
    """
    parts = following_of(setting, linear_of(setting, before), _change(before, after))
    outputs = setting.places.outputs
    return float(parts[outputs.index(place)] if place in outputs else np.max(parts))


def _change(before: Fit, after: Fit) -> list[Array]:
    return [a - b for a, b in zip(before.residuals, after.residuals, strict=True)]


def discrepancy_of(setting: Setting, tuned: Fit, best: Fit) -> Discrepancy:
    """Return how much of what `best` explains may be model discrepancy of its effects."""
    outputs = setting.places.outputs
    if not best.candidates:
        return Discrepancy(tuple(outputs), (0.0,) * len(outputs))
    left = squares_of(setting, best.residuals)
    explained = np.maximum(squares_of(setting, tuned.residuals) - left, 0.0)

    @cache  # often two of these sets are one, and each is a simulation of all records
    def beside(kept: tuple[Effect, ...]) -> Array:
        """Return what the other effects explain beside those that are `kept`."""
        if not kept or len(kept) == len(best.effects):
            return np.zeros_like(explained) if kept else explained
        moved = left_by(setting, turned(setting.nominal, setting.nuisances, best.change), kept)
        return np.clip(squares_of(setting, moved) - left, 0.0, explained)

    by_law = beside(tuple(e for e in best.effects if e.exact))
    nonlinear = beside(tuple(e for e in best.effects if e.linear_form))
    neither = beside(tuple(e for e in best.effects if e.exact or e.linear_form))
    by_nonlinear_law = np.minimum(neither, np.minimum(by_law, nonlinear))
    parts = _LAW * by_law + _EXACT * (explained - by_law)
    # what is linear, by a law and exactly
    lawful, exactly = by_law - by_nonlinear_law, np.maximum((explained - by_law) - (nonlinear - by_nonlinear_law), 0.0)
    linear = (_LAW - _STEADY) * lawful + (_EXACT - _STEADY) * exactly
    return Discrepancy(tuple(outputs), tuple(parts.tolist()), tuple(linear.tolist()))


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
    """Return the frequencies (m,) of a record's bins, in cycles per sample, and (m, n_y, 1 + n_u) of its spectra.

    The first are those of the change, then those of the answers to each input, all in units of the noise.
    """
    answers = [response(model, record.u[:, j], j, through_delay=True) for j in range(record.u.shape[1])]
    frequency: list[Array] = []
    spectra: list[Spectrum] = []
    for start, stop in stretches_of(record.fitted()):
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
    """Return bands of bins (first, last), each with the equivalent of `lines` bins of equal power, or all there are.

    Power is compared within a band only: it falls by orders of magnitude beyond a resonance, where bins count too.
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
        # too few bins remain for a band of their own
        bands = [*bands[:-1], (bands[-1][0] if bands else 0, frequency.size)]
    return bands
