"""Whether the outputs were sampled by another clock than the inputs: a delay that grows steadily with time.

Then the phase of every frequency drifts at a rate proportional to it, and no amplitude changes. Resonances that move,
as by warmth, shift the phase near them only and change the amplitudes as well: a drift that is not proportional to
frequency is not reported as one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.base import Array, Fact, Seen
from campaigns.facts.blocks import Blocks, Spectrum, excited, period_blocks, windowed_blocks
from campaigns.facts.stretches import Stretch

NAME = "clock"

LARGEST = 2e-3
"""Difference of two clocks that is searched for: quartz is off by 1e-4 at most, a computer's timer by 1e-3."""

SIGNIFICANT = 6.0
"""Standard deviations from which on a difference is reported: the scatter they are of comes from few blocks."""

LEAST_BLOCKS = 6
LEAST_LINES = 4
MOST_BLOCKS = 64
MOST_LINES = 512
FEW_PERIODS = 16
"""Periods below which parts of them are looked at as well: a clock may lose many samples within one."""

MOST_TRIED = 200
SHORTEST, LONGEST = 128, 8192

SPAN = 1.5
"""Highest frequency over the lowest that tell a clock from a phase."""

ALIGNED = 0.3
"""Least common part of the power of all blocks after correction of the phase: of noise excitation it is a half."""

OTHER = 0.1
"""Part of the phase drift of all bins that may be different from a clock's."""


@dataclass(frozen=True)
class Drift:
    """A difference, its standard deviation, which part of the bins' drift is different, and over what time.

    `halves` tells whether either half of the bins, every other one, shows it by itself.
    """

    relative: float
    std: float
    other: float
    rows: int
    halves: bool

    @property
    def found(self) -> bool:
        """Whether two clocks are reported: significant, not too large, and in all bins alike."""
        return SIGNIFICANT * self.std < abs(self.relative) < LARGEST and self.other < OTHER and self.halves


def facts(seen: Seen, stretches: Sequence[Stretch], known: Sequence[Fact]) -> list[Fact]:
    """Return the difference between the clock of the outputs and that of the inputs, output by output."""
    repeating = period_blocks([s for s in stretches if s.periods >= 3])
    free = _free_blocks(stretches)
    found = []
    for o, name in enumerate(seen.of_role("output")):
        # whose phase drifts with an output's clock: its bins where they repeat, otherwise its cross-spectra
        turning = [(blocks.outputs[:, :, o], blocks) for blocks in repeating]
        turning += [(_cross(blocks, o), blocks) for blocks in free]
        drifts = [d for z, blocks in turning if (d := drift_of(z, blocks)) is not None]
        if drifts:
            found.append(_fact(name, min(drifts, key=lambda d: d.std), seen.rate_hz))
    return found


def _free_blocks(stretches: Sequence[Stretch]) -> list[Blocks]:
    """Return blocks of what does not repeat, or seldom."""
    free = [s for s in stretches if s.periods < FEW_PERIODS and s.rows >= LEAST_BLOCKS * SHORTEST]
    if not free:
        return []
    longest = max(s.rows for s in free)
    length = int(np.clip(2 ** int(np.log2(max(2 * longest // MOST_BLOCKS, 1))), SHORTEST, LONGEST))
    blocks = windowed_blocks(free, length)
    return [] if blocks is None else [blocks]


def _cross(blocks: Blocks, o: int) -> Spectrum:
    """Return the cross-spectra (b, f) of an output and the input that explains most of it."""
    y = blocks.outputs[:, :, o]
    each = [y * blocks.inputs[:, :, j].conj() for j in range(blocks.inputs.shape[2])]
    power = [np.mean(np.abs(blocks.inputs[:, :, j]) ** 2, axis=0) for j in range(len(each))]
    explains = [
        float(np.sum(np.abs(z.mean(axis=0)) ** 2 / np.maximum(p, np.finfo(float).tiny)))
        for z, p in zip(each, power, strict=True)
    ]
    return each[int(np.argmax(explains))]


def drift_of(z: Spectrum, blocks: Blocks) -> Drift | None:
    """Return how the phase of the bins of `z` (b, f) drifts with time, None where there are too few."""
    counts = np.bincount(blocks.stretch)
    kept = counts[blocks.stretch] >= LEAST_BLOCKS
    lines = excited(np.mean(np.abs(blocks.inputs) ** 2, axis=0))
    # a bin that is played in some blocks only, as in a sweep, contains those alone
    size = np.abs(z)
    lines &= np.mean(size > 0.05 * size.mean(axis=0), axis=0) > 0.75
    if not kept.any() or lines.sum() < LEAST_LINES:
        return None
    used = np.flatnonzero(lines)
    used = used[:: -(-used.size // MOST_LINES)]
    z, stretch = z[kept][:, used], blocks.stretch[kept]
    omega = 2.0 * np.pi * blocks.line[used] / blocks.length
    if omega.max() < SPAN * omega.min():
        return None
    at: Array = np.zeros(stretch.size)
    at += blocks.start[kept]
    for i in np.unique(stretch):
        at[stretch == i] -= at[stretch == i].mean()
    # every bin counts alike: the slow ones are the strongest, and turn the least
    even = z / np.maximum(np.sqrt(np.mean(np.abs(z) ** 2, axis=0)), np.finfo(float).tiny)
    starts = (0.0, _coarse(even, at, stretch, omega))
    return _fine(z, at, stretch, omega, max(starts, key=lambda start: _alignment(even, at, stretch, omega, start)))


def _alignment(z: Spectrum, at: Array, stretch: NDArray[np.intp], omega: Array, relative: float) -> float:
    """Return how large the mean of all blocks is after phase correction by a difference."""
    back = z * np.exp(-1j * relative * np.outer(at, omega))
    return float(sum(np.sum(np.abs(back[stretch == i].sum(axis=0)) ** 2) for i in np.unique(stretch)))


def _coarse(z: Spectrum, at: Array, stretch: NDArray[np.intp], omega: Array) -> float:
    """Return the difference that best maps blocks to later ones, near ones first, then those farther apart.

    Far ones are more accurate, but only near ones resolve the number of whole turns.
    """
    step = float(np.median(np.diff(at)[np.diff(stretch) == 0]))
    best, width, apart, farthest = 0.0, LARGEST, 1, int(np.bincount(stretch).max()) - 1
    turned = np.zeros((0, omega.size), dtype=complex)
    while True:
        for lag in range(turned.shape[0] + 1, apart + 1):
            same = (stretch[lag:] == stretch[:-lag]) & (np.abs(at[lag:] - at[:-lag] - lag * step) < 0.5 * step)
            turned = np.concatenate([turned, np.sum((z[lag:] * z[:-lag].conj())[same], axis=0)[None]])
        lags = step * np.arange(1, apart + 1)
        size = np.abs(turned).sum(axis=0)
        mean = float(np.sqrt(size @ omega**2 / max(size.sum(), np.finfo(float).tiny)))
        fine = 0.2 / (mean * step * apart)
        grid = best + np.linspace(-width, width, 2 * int(np.clip(width / fine, 1, MOST_TRIED)) + 1)
        fit = [np.real(np.sum(turned * np.exp(-1j * g * np.outer(lags, omega)))) for g in grid]
        best, width = float(grid[int(np.argmax(fit))]), 1.0 / (mean * step * apart)
        if apart == farthest:
            return best
        apart = min(3 * apart, farthest)


def _fine(z: Spectrum, at: Array, stretch: NDArray[np.intp], omega: Array, start: float) -> Drift | None:
    """Return the drift by linear least squares of the remaining phase after correction by `start`.

    The scatter of the delays of single blocks about their line gives its standard deviation, so that whatever makes
    them scatter is in it.
    """
    members = [np.flatnonzero(stretch == i) for i in np.unique(stretch)]
    time = np.concatenate([at[m] for m in members])
    order = np.concatenate(members)
    free = order.size - len(members) - 1
    if free < 3:
        return None
    total = float(time @ time)
    relative = start
    for _ in range(3):
        last = relative
        back = z * np.exp(-1j * relative * np.outer(at, omega))
        off = np.concatenate([_against_mean(back[m]) for m in members])
        slope = time @ off / total
        rest = off - np.outer(time, slope)
        phase, size = np.maximum(np.sum(rest.imag**2, axis=0) / free, 1e-24), np.sum(rest.real**2, axis=0) / free
        weight = omega / phase / np.sum(omega**2 / phase)
        relative += float(time @ (off.imag @ weight) / total)
    sizes = [m.size for m in members]
    _, std = _line_of(off.imag, omega, phase, time, sizes)
    halves = [_line_of(off.imag[:, k::2], omega[k::2], phase[k::2], time, sizes) for k in (0, 1)]
    own, apart = [last + s for s, _ in halves], np.hypot(halves[0][1], halves[1][1])
    alike = abs(own[0] - own[1]) < max(0.5 * OTHER * abs(relative), SIGNIFICANT * apart)
    both = alike and all(abs(s) > 0.5 * SIGNIFICANT * e for s, (_, e) in zip(own, halves, strict=True))
    if _aligned(back, members) < ALIGNED:
        return None
    # each bin's own drift beyond that of noise, against that of a clock
    turn = np.sum(np.maximum(slope.imag**2 * total / phase - 1.0, 0.0))
    grow = np.sum(np.maximum(slope.real**2 * total / np.maximum(size, 1e-24) - 1.0, 0.0))
    other = float(max(turn, grow) / max(np.sum((omega * relative) ** 2 * total / phase), np.finfo(float).tiny))
    return Drift(relative, std, other, int(at.max() - at.min()), both)


def _aligned(z: Spectrum, members: Sequence[NDArray[np.intp]]) -> float:
    """Return which part of the power of all blocks (b, f) is that of their means."""
    steady = sum(m.size * np.sum(np.abs(z[m].mean(axis=0)) ** 2) for m in members)
    return float(steady / max(np.sum(np.abs(z) ** 2), np.finfo(float).tiny))


def _line_of(phases: Array, omega: Array, noise: Array, time: Array, sizes: Sequence[int]) -> tuple[float, float]:
    """Return the slope of the blocks' delays, from `phases` (b, f) of so much `noise` (f,), and its deviation."""
    delay = phases @ (omega / noise) / np.sum(omega**2 / noise)  # samples, block by block
    total = float(time @ time)
    slope = float(time @ delay / total)
    left = delay - slope * time
    free = time.size - len(sizes) - 1
    return slope, float(np.sqrt(left @ left / free / total * _alike(left, sizes)))


def _against_mean(z: Spectrum) -> Spectrum:
    """Return each block's (b, f) difference from its mean, relative to it: amplitude real, phase imaginary."""
    mean = z.mean(axis=0)
    return z * mean.conj() / np.maximum(np.abs(mean) ** 2, np.finfo(float).tiny) - 1.0


def _alike(left: Array, sizes: Sequence[int]) -> float:
    """Return by how much the variance of a slope grows because each block is like the next."""
    edges = np.cumsum(sizes)[:-1] - 1
    pairs = np.delete(np.arange(left.size - 1), edges)
    power = float(left @ left)
    rho = float(np.clip(left[pairs] @ left[pairs + 1] / power, 0.0, 0.9)) if power > 0.0 else 0.0
    return (1.0 + rho) / (1.0 - rho)


def _fact(name: str, drift: Drift, rate_hz: float) -> Fact:
    numbers = {"found": int(drift.found), "ppm": 1e6 * drift.relative, "std_ppm": 1e6 * drift.std}
    if drift.found:
        late = drift.relative * drift.rows
        text = (
            f"{name} is sampled by another clock than the inputs: {1e6 * drift.relative:.4g} ± "
            f"{1e6 * drift.std:.2g} ppm, {abs(late):.3g} samples, {abs(late) / rate_hz:.3g} s, over the record"
        )
        means = (
            "phases drift with time and lines leave their bins, which a diagnosis can only call sample-clock-error: "
            "sample both by one clock, or resample one of them"
        )
        return Fact(NAME, text, means, name, numbers=numbers)
    if abs(drift.relative) > SIGNIFICANT * drift.std:
        text = (
            f"{name}: phases drift with time, but not as two clocks would: {100.0 * drift.other:.0f} % of it is not "
            "proportional to frequency"
        )
    else:
        text = f"{name}: no difference of clocks is seen; one of {1e6 * SIGNIFICANT * drift.std:.2g} ppm would be"
    return Fact(NAME, text, channel=name, numbers=numbers, remark=False)
