"""Two measured frequency responses side by side: what of them is known, and whether they agree within their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.comparison.table import SAME, Row, beside
from analysis.identification.missed_response import CLEAR
from analysis.identification.response_curves import ResponseCurve
from analysis.pages.formats import readable
from sim_backend.linear import Array, ComplexArray

KNOWN = 0.1
"""Largest standard deviation of a magnitude that is compared, relative to it."""

NEIGHBOURS = 3
NEAR = 0.1
"""A variance is held against those of so many lines to either side, or of all lines within this part of the frequency:
one that few periods give is too small by chance at some line of many."""

SHARED = 2.0
"""How many neighbouring lines may have one error: the windows of an averaged response overlap."""


@dataclass(frozen=True)
class Entry:
    """One measured entry: its curve, the standard deviation of its magnitude (n_f,), and which lines are known (n_f,).

    The deviation is None where the record cannot tell it; then every line counts as known.
    """

    curve: ResponseCurve
    std: Array | None
    known: NDArray[np.bool_]

    @property
    def place(self) -> tuple[str, str]:
        """Output and input."""
        return self.curve.output, self.curve.input

    @property
    def response(self) -> ComplexArray:
        """The complex response (n_f,), NaN where it is not known."""
        complete = self.curve.magnitude * np.exp(1j * self.curve.phase_rad)
        return np.where(self.known, complete, np.nan)


def entry_of(curve: ResponseCurve) -> Entry:
    """Return a curve with what of it is known."""
    driven = curve.magnitude > 0.0
    if not np.isfinite(curve.std).all():
        return Entry(curve, None, driven)
    own = np.maximum(curve.std, SAME * curve.magnitude)
    std = np.maximum(own, _of_neighbours(curve.frequency_hz, own)) if driven.any() else own
    return Entry(curve, std, driven & (std <= KNOWN * curve.magnitude))


def _of_neighbours(f: Array, std: Array) -> Array:
    """Return the deviation (n_f,) that the neighbours of each line have, by the mean of the logarithms of theirs.

    A resonance beside it does not count for more than one line there.
    """
    lines = np.arange(f.size)
    low = np.minimum(np.searchsorted(f, (1.0 - NEAR) * f), np.maximum(lines - NEIGHBOURS, 0))
    high = np.maximum(np.searchsorted(f, (1.0 + NEAR) * f), np.minimum(lines + NEIGHBOURS + 1, f.size))
    total = np.concatenate([[0.0], np.cumsum(np.log(np.maximum(std, np.finfo(float).tiny)))])
    # the logarithm of a variance from one degree of freedom, which is exponential, has Euler's constant below its mean
    return np.asarray(np.exp((total[high] - total[low]) / (high - low) + 0.5 * np.euler_gamma))


@dataclass(frozen=True)
class _Pair:
    """Both responses (n,) at frequencies (n,) where both are known.

    `std` (2, n) are the deviations of both magnitudes and `apart` (n,) that of the complex difference, as E|error|²;
    None where a record cannot tell them.
    """

    frequency_hz: Array
    responses: tuple[ComplexArray, ComplexArray]
    std: tuple[Array, Array] | None
    apart: Array | None


def compared(both: tuple[Sequence[Entry], Sequence[Entry]], units: dict[tuple[str, str], str]) -> tuple[list[Row], str]:
    """Return the rows of every entry that both records know, and in words what agrees and what is left out."""
    second = {entry.place: entry for entry in both[1]}
    rows: list[Row] = []
    said: list[str] = []
    unknown: list[str] = []
    for one in both[0]:
        other = second.get(one.place)
        if other is None:
            continue
        output, source = one.place
        name = f"{source} → {output}"
        if not (one.known.any() or other.known.any()):
            unknown.append(name)
            continue
        pair = _common(one, other)
        if pair.frequency_hz.size == 0:
            said.append(f"{name}: no frequency is known to {100.0 * KNOWN:g} % in both.")
            continue
        rows += _rows(name, pair, (one, other), units.get(one.place, ""))
        said.append(f"{name}: {_agreement(pair)} {_left_out((one, other))}".rstrip())
    if unknown:
        said.append(
            f"Left out of table and figures, as neither record knows a frequency of it to {100.0 * KNOWN:g} %: "
            f"{', '.join(unknown)}. Nothing drives these outputs, or their response is lost in noise."
        )
    return rows, "\n".join(said)


def _common(one: Entry, other: Entry) -> _Pair:
    """Return both at the known lines of the first that lie at, or between two neighbouring, known lines of the second.

    By how much the second changes between a frequency and its nearest line counts as not known.
    """
    f, grid = one.curve.frequency_hz, other.curve.frequency_hz
    right = np.clip(np.searchsorted(grid, f), 1, max(grid.size - 1, 1))
    left = right - 1
    right = np.minimum(right, grid.size - 1)
    span = np.where(right > left, grid[right] - grid[left], 1.0)
    part = (f - grid[left]) / span
    for at, end in ((left, 0.0), (right, 1.0)):  # rounding makes no line another
        part[np.abs(f - grid[at]) <= SAME * f] = end
    known = one.known & (part >= 0.0) & (part <= 1.0)
    known &= (other.known[left] | (part == 1.0)) & (other.known[right] | (part == 0.0))
    part, left, right = part[known], left[known], right[known]

    response = np.nan_to_num(other.response)  # what is not known has no part in it
    changes = np.abs(response[right] - response[left]) * np.minimum(part, 1.0 - part)
    responses = one.response[known], (1.0 - part) * response[left] + part * response[right]
    if one.std is None or other.std is None:
        return _Pair(f[known], responses, None, None)
    between = (1.0 - part) * other.std[left] + part * other.std[right]
    std = one.std[known], np.hypot(between, changes)
    return _Pair(f[known], responses, std, 2.0 * (std[0] ** 2 + std[1] ** 2))


def _rows(name: str, pair: _Pair, both: tuple[Entry, Entry], unit: str) -> list[Row]:
    f = pair.frequency_hz
    at = f"{readable(f[0])} Hz" if f.size == 1 else f"{readable(f[0])} to {readable(f[-1])} Hz"
    means, stds = _means(pair)
    rows = [beside(f"{name}, {at}, mean magnitude", means, unit, stds)]
    peaks = [_peak(entry) for entry in both]
    if all(peak is not None for peak in peaks):
        found = [peak for peak in peaks if peak is not None]
        rows.append(beside(f"{name}, largest at", (hz for hz, _ in found), "Hz", (std for _, std in found)))
    return rows


def _means(pair: _Pair) -> tuple[list[float], list[float | None]]:
    """Return the geometric mean of both magnitudes, each line weighted by how well their ratio is known."""
    sizes = [np.abs(response) for response in pair.responses]
    if pair.std is None:
        return [float(np.exp(np.mean(np.log(size)))) for size in sizes], [None, None]
    relative = [std / size for std, size in zip(pair.std, sizes, strict=True)]
    weights = 1.0 / (relative[0] ** 2 + relative[1] ** 2)
    weights /= weights.sum()
    means = [float(np.exp(weights @ np.log(size))) for size in sizes]
    parts = [float(np.sqrt(SHARED * (weights**2 @ each**2))) for each in relative]
    return means, [min(part, 1.0) * mean for part, mean in zip(parts, means, strict=True)]


def _peak(entry: Entry) -> tuple[float, float | None] | None:
    """Return the frequency of the largest magnitude and its deviation; None where a larger one may not be known."""
    f = entry.curve.frequency_hz
    size = np.where(entry.known, entry.curve.magnitude, 0.0)
    k = int(np.argmax(size))
    if not 0 < k < f.size - 1 or not entry.known[k - 1 : k + 2].all():
        return None
    if entry.std is None:
        return float(f[k]), None
    # any line may be the largest that is within two deviations of it, and half of the way to the next
    near = np.flatnonzero(size >= size[k] - 2.0 * np.hypot(entry.std, entry.std[k]))
    first, last = int(near[0]), int(near[-1])
    width = 0.5 * (f[min(last + 1, f.size - 1)] + f[last] - f[first] - f[max(first - 1, 0)])
    return float(f[k]), float(width / np.sqrt(12.0))


def _agreement(pair: _Pair) -> str:
    """Return in words whether both agree within their noise, and the line that is furthest out of it."""
    count = pair.frequency_hz.size
    here = f"the {count} frequencies that both know to {100.0 * KNOWN:g} %" if count > 1 else "the one known frequency"
    if pair.apart is None:
        return "A record of one period tells no noise: what differs may be noise."
    apart = np.abs(pair.responses[1] - pair.responses[0])
    deviation = np.sqrt(pair.apart)
    k = int(np.argmax(apart / deviation))
    size = 100.0 / np.abs(pair.responses[0][k])
    most = (
        f"{readable(size * apart[k], 2)} ± {readable(size * deviation[k], 2)} % at {readable(pair.frequency_hz[k])} Hz"
    )
    far = int(np.sum(apart > CLEAR * deviation))
    if far:
        return f"A and B differ by more than noise at {far} of {here}, most clearly by {most}."
    means, stds = _means(pair)
    whole = float(np.linalg.norm([std or 0.0 for std in stds]))
    if abs(means[1] - means[0]) > CLEAR * whole:
        change, std = (100.0 * value / means[0] for value in (means[1] - means[0], whole))
        return (
            f"A and B differ by more than noise in their mean over {here}, by {readable(change, 2)} ± "
            f"{readable(std, 2)} %."
        )
    return f"A and B agree within noise at {here}: the most significant difference is {most}."


def _left_out(both: tuple[Entry, Entry]) -> str:
    """Return in words how many lines of each are not known well enough."""
    counts = [f"{int(np.sum(~entry.known))} of {entry.known.size}" for entry in both]
    if all(entry.known.all() for entry in both):
        return ""
    return f"Left out as known less well: {counts[0]} frequencies of A, {counts[1]} of B."
