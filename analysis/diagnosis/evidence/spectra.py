"""Spectra of whitened residuals in bands, and two tests that need no model of the noise's colour.

An autoregression, however it is chosen, misses the noise's spectrum by a little everywhere, and in a long record that
would look like an error of the model. So significance comes from comparing inside each band: what repeats from period
to period against what does not, or, without periods, what follows the inputs against what does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.tails import chi2_tail, f_tail
from analysis.identification.loop_at_once import echo_of
from sim_backend.linear import Array

PER_DECADE = 16


@dataclass(frozen=True)
class Bands:
    """Mean ordinate `power` and their `count` in bands with `edges` (bands, 2) and `centre`, in Hz."""

    centre: Array
    edges: Array
    power: Array
    count: Array


@dataclass(frozen=True)
class Repeat:
    """`count` periods of `period` samples that follow one another from sample `start`."""

    start: int
    period: int
    count: int


def bands(w: Array, parts: Sequence[int], rate_hz: float) -> Bands:
    """Return the spectrum of `w` (n,), given in `parts` that follow one another, in logarithmic bands.

    Ordinates are |FFT|²/n, which for white noise of unit variance are exponential with mean 1.
    """
    edges = _edges(max(parts), rate_hz)
    total, count = np.zeros(edges.size - 1), np.zeros(edges.size - 1)
    at = 0
    for n in parts:
        lines, band = _lines(n, rate_hz, edges)
        power = np.abs(np.fft.rfft(w[at : at + n])[lines]) ** 2 / n
        at += n
        total += np.bincount(band, weights=power, minlength=total.size)
        count += np.bincount(band, minlength=count.size)
    full = count > 0
    pairs = np.stack([edges[:-1], edges[1:]], axis=1)[full]
    return Bands(np.sqrt(pairs[:, 0] * pairs[:, 1]), pairs, total[full] / count[full], count[full])


def _edges(longest: int, rate_hz: float) -> Array:
    low = rate_hz / longest
    number = max(int(np.ceil(PER_DECADE * np.log10(rate_hz / 2.0 / low))), 1)
    return np.geomspace(low * 0.999, rate_hz / 2.0, number + 1)


def _lines(n: int, rate_hz: float, edges: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the frequency bins of `n` samples (without 0 Hz and half the rate) and the band of each."""
    lines = np.arange(1, (n + 1) // 2)
    return lines, np.clip(np.searchsorted(edges, lines * rate_hz / n, side="right") - 1, 0, edges.size - 2)


def repeat_test(w: Array, repeats: Sequence[Repeat], rate_hz: float) -> float:
    """Return the p-value of "nothing of `w` (n,) repeats": per band, mean period against deviations from it, F test."""
    edges = _edges(max(r.period for r in repeats), rate_hz)
    same, same_dof, other, other_dof = (np.zeros(edges.size - 1) for _ in range(4))
    for r in repeats:
        periods = w[r.start : r.start + r.count * r.period].reshape(r.count, r.period)
        lines, band = _lines(r.period, rate_hz, edges)
        spectra = np.fft.rfft(periods, axis=1)[:, lines]
        mean = spectra.mean(axis=0)
        for total, dof, power, per_line in (
            (same, same_dof, r.count * np.abs(mean) ** 2, 2.0),
            (other, other_dof, np.sum(np.abs(spectra - mean) ** 2, axis=0), 2.0 * (r.count - 1)),
        ):
            # of a period of n samples every ordinate is worth n, whatever the period of another stretch
            total += np.bincount(band, weights=power / r.period, minlength=total.size)
            dof += per_line * np.bincount(band, minlength=dof.size)
    full = same_dof > 0.0
    ratio = (same[full] / same_dof[full]) / np.maximum(other[full] / other_dof[full], np.finfo(float).tiny)
    return _over_bands(ratio, same_dof[full], other_dof[full])


def _over_bands(ratio: Array, dof: Array, other_dof: Array) -> float:
    """Return one p-value of independent variance ratios: twice the smaller of Šidák's (one) and Fisher's (many)."""
    p = np.maximum(f_tail(ratio, dof, other_dof), np.finfo(float).tiny)
    one = float(-np.expm1(p.size * np.log1p(-min(float(p.min()), 1.0 - 1e-16))))
    many = float(chi2_tail(-2.0 * np.sum(np.log(p)), 2 * p.size))
    return min(1.0, 2.0 * min(one, many))


def coherence_test(w: Array, u: Array, parts: Sequence[int], rate_hz: float) -> float:
    """Return the p-value of "nothing of `w` (n,) follows the inputs `u` (n, n_u)": one gain per band and input, F test.

    A gain that changes within a band only costs power. Bands with too few bins for a comparison are left out. Where a
    closed loop responds to what it measures, the inputs follow the noise; there only their earlier innovations count.
    """
    cuts = np.cumsum(parts)[:-1]
    echo = echo_of(np.split(w, cuts), np.split(u, cuts))
    if echo.may_come_back:
        return float(chi2_tail(echo.before, echo.tests))
    edges = _edges(max(parts), rate_hz)
    pieces: list[list[Array]] = [[] for _ in range(edges.size - 1)]
    at = 0
    for n in parts:
        lines, band = _lines(n, rate_hz, edges)
        joint = np.fft.rfft(np.column_stack([w[at : at + n], u[at : at + n]]), axis=0)[lines] / np.sqrt(n)
        at += n
        cuts = np.searchsorted(band, np.arange(edges.size))
        for b in range(edges.size - 1):
            pieces[b].append(joint[cuts[b] : cuts[b + 1]])
    ratio, dof, other = [], [], []
    for piece in pieces:
        joint = np.concatenate(piece)
        size = np.linalg.norm(joint[:, 1:], axis=0)
        driven = size > 0.0
        k = int(driven.sum())
        if k == 0 or joint.shape[0] < 2 * k + 2:
            continue
        q, _ = np.linalg.qr(joint[:, 1:][:, driven] / size[driven])
        followed = float(np.sum(np.abs(q.conj().T @ joint[:, 0]) ** 2))
        left = max(float(np.sum(np.abs(joint[:, 0]) ** 2)) - followed, np.finfo(float).tiny)
        free = joint.shape[0] - k
        ratio.append((followed / k) / (left / free))
        dof.append(2.0 * k)
        other.append(2.0 * free)
    return _over_bands(np.array(ratio), np.array(dof), np.array(other)) if ratio else 1.0


def explained_by_shifts(w: Array, columns: Array) -> Array:
    """Return the sum of squares that orthonormal `columns` (n, k) explain of `w` (n,) at every circular shift, (n,)."""
    spectrum = np.fft.rfft(w)
    total = np.zeros(w.size)
    for j in range(columns.shape[1]):
        total += np.fft.irfft(spectrum * np.conj(np.fft.rfft(columns[:, j])), w.size) ** 2
    return total
