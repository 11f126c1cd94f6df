"""How much stronger than white a filtered noise still is, band by band."""

from __future__ import annotations

import numpy as np
import scipy

from analysis.diagnosis.noise.whitener import band_of
from analysis.diagnosis.tails import f_tail
from sim_backend.linear import Array

BAND_ROWS, _MAX_BANDS = 12, 24
"""Fewest coefficients of a band: their median is known to 40 %; and the most bands."""

_KNOWN_ROWS = 24
"""The mean square of so many normal numbers is known to 30 %."""

_GROWTH = 1.5
"""Ratio of a band's edges: noise spectra are smooth on a logarithmic scale, and high bands have enough coefficients."""

_MEDIAN_OF_SQUARE = 0.4549
"""Median of the square of a standard normal number."""

_EFFICIENCY = 0.37
"""A median of squares knows their level as well as the mean of so many times fewer."""

_NEVER = 1e-6
"""Coefficients are called weaker than their filter says where that happens by chance no more often than this."""

_BY_CHANCE = 1e-3
"""Two levels are taken for one unless they differ by more than happens so seldom by chance."""


def levels_of_medians(spectra: list[tuple[Array, Array]], highest: float) -> tuple[Array, Array]:
    """Return edges and levels of the bands below `highest` from medians; nothing where there are too few coefficients.

    `spectra` hold frequency and power (n,) of each output; edges are (k + 1,) in cycles per sample, levels (n_y, k). A
    level may be below one: `no_weaker` and `held_by_few` say what that means.
    """
    below = np.sort(spectra[0][0][spectra[0][0] < highest])
    count = min(below.size // BAND_ROWS, _MAX_BANDS)
    if count < 1:
        return np.zeros(1), np.zeros((len(spectra), 0))
    # bands contain growing numbers of coefficients, so that they are narrow where the level changes fast
    share = np.linspace(0.0, 1.0, count + 1) ** 2
    at = np.unique(np.maximum((share * below.size).astype(int), BAND_ROWS * np.arange(count + 1)))
    # records of one length share their frequencies: a dozen coefficients may be at one, and no band has zero width
    edges = np.append(np.unique(below[np.minimum(at[:-1], below.size - 1)]), highest)
    levels = np.ones((len(spectra), edges.size - 1))
    for o, (frequency, power) in enumerate(spectra):
        band = band_of(edges, frequency)
        for b in range(edges.size - 1):
            inside = power[band == b]
            if inside.size:
                levels[o, b] = float(np.median(inside)) / _MEDIAN_OF_SQUARE
    return edges, levels


def held_by_few(spectrum: tuple[Array, Array], highest: float) -> bool:
    """Tell whether few coefficients below `highest` are so large that the filter takes all of them for strong noise.

    `spectrum` holds frequency (n,) in cycles per sample and power (n,). A drift of a reading is in the lowest
    coefficients alone, but a filter has no such edge: it weakens whatever is slow, and most coefficients there are then
    far weaker than one, more than happens by chance. (A step is different: its power falls with the square of the
    frequency, as that of a random walk.)
    """
    frequency, power = spectrum
    below = power[np.argsort(frequency)][: int(np.sum(frequency < highest))]
    counts = BAND_ROWS * 2 ** np.arange(int(np.log2(max(below.size // BAND_ROWS, 1))) + 1)
    if below.size < BAND_ROWS:
        return False
    known = _EFFICIENCY * counts
    levels = np.array([np.median(below[:count]) for count in counts]) / _MEDIAN_OF_SQUARE
    return bool(np.min(scipy.special.chdtr(known, known * levels)) * counts.size < _NEVER)


def no_weaker(edges: Array, levels: Array, taps: Array) -> Array:
    """Return `levels` (k,) with which a noise filtered by `taps` is nowhere weaker than at higher frequencies.

    Shapes: `edges` (k + 1,) in cycles per sample, rising; `taps` (p,); `levels` (k,), as the result, are powers of the
    filtered noise in each band relative to that at the last edge. Bands that are weaker than a higher one share a level
    with it (isotonic regression).
    """
    places = np.append(0.5 * (edges[:-1] + edges[1:]), edges[-1])
    passed = np.abs(np.exp(-2j * np.pi * np.outer(places, np.arange(taps.size))) @ taps) ** 2
    power = levels / passed[:-1]
    falling = scipy.optimize.isotonic_regression(power, weights=np.diff(edges), increasing=False).x
    return np.asarray(np.maximum(falling, 1.0 / passed[-1]) * passed[:-1])


def levels_of_means(
    spectra: list[tuple[Array, Array]], lowest: float, left: list[tuple[Array, Array]]
) -> tuple[Array, Array]:
    """Return upper edges (k,) and levels (n_y, k) of the bands above `lowest`, each wide enough for its mean.

    `spectra`, frequency and power (n,) of each output, are those of noise alone. `left`, those of the residual of a
    model, contain as much noise and perhaps an error of the model; where they agree within the uncertainty of a band's
    few coefficients, they count as well.
    """
    frequency = np.sort(spectra[0][0][spectra[0][0] >= lowest])
    edges, at = [lowest], 0
    while frequency.size - at >= 2 * _KNOWN_ROWS:
        at = max(at + _KNOWN_ROWS, int(np.searchsorted(frequency, _GROWTH * edges[-1])))
        if at >= frequency.size - _KNOWN_ROWS:
            break
        edges.append(float(frequency[at]))
    bounds = np.array([*edges, 0.5])
    levels = np.ones((len(spectra), bounds.size - 1))
    for o, ((at_noise, power), (at_left, power_left)) in enumerate(zip(spectra, left, strict=True)):
        band, band_left = band_of(bounds, at_noise), band_of(bounds, at_left)
        for b in range(bounds.size - 1):
            inside = power[band == b]
            if inside.size >= _KNOWN_ROWS:
                levels[o, b] = _pooled(inside, power_left[band_left == b])
    return bounds[1:], levels


def _pooled(noise: Array, left: Array) -> float:
    """Return the level of `noise` (n,), estimated from `left` (m,) as well where both may have one level."""
    own, count = float(noise.mean()), _EFFICIENCY * left.size
    other = float(np.median(left)) / _MEDIAN_OF_SQUARE if left.size else 0.0
    ratio = other / max(own, np.finfo(float).tiny)
    if not _BY_CHANCE < f_tail(ratio, count, noise.size) < 1.0 - _BY_CHANCE:
        return own
    return (noise.size * own + count * other) / (noise.size + count)
