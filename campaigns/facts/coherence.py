"""How much of an output the inputs explain at each frequency, all of them together.

From periods it is what repeats, from anything else the multiple coherence of Welch's spectra: J. Bendat and A.
Piersol, Random Data, 4th edition, 2010, section 7.3. Both are without what chance adds to so few averages.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.bands import lowest_of, shares_of
from campaigns.facts.base import Array, Fact, Seen
from campaigns.facts.blocks import Blocks, excited, period_blocks, windowed_blocks
from campaigns.facts.stretches import Stretch

NAME = "coherence"

LOW = 0.9
"""Coherence below which a bin is called low, and explained power below which a record is: a tenth is unexplained."""

AVERAGES = 6
"""Blocks that Welch's spectra are averaged over, for each input and one more."""

SHORTEST = 64
LONGEST = 2**14

OVERLAP = 2.0 / 36.0
"""By which part more blocks that overlap by half are needed: twice the squared correlation of two Hann windows, 1/6
(P. Welch, IEEE Trans. Audio Electroacoustics 15, 1967)."""

LEAKS = 1.2
"""By how much more is unexplained with blocks half as long, from which on it is leakage: of the answer to what was
played before a block, half as much is in a block twice as long, and more where it rings for longer than both."""


@dataclass(frozen=True)
class _Coherence:
    """Power of an output at the excited lines, and which of it the inputs explain, (f,) each."""

    frequency_hz: Array
    steady: Array
    total: Array

    @property
    def share(self) -> Array:
        """Coherence (f,)."""
        return np.clip(self.steady / self.total, 0.0, 1.0)

    @property
    def explained(self) -> float:
        """Part of the power at all these lines."""
        return min(max(float(self.steady.sum() / self.total.sum()), 0.0), 1.0)


def facts(seen: Seen, stretches: Sequence[Stretch], known: Sequence[Fact]) -> list[Fact]:
    """Return for each output how many excited lines are low, and how much of its power the inputs explain, by bands."""
    repeating = [s for s in stretches if s.periods >= 2]
    free = [s for s in stretches if s.periods < 2]
    periods = period_blocks(repeating)
    found = []
    for o, name in enumerate(seen.of_role("output")):
        told: list[_Coherence] = []
        leaking = False
        for blocks in periods:
            told.append(_of_periods(blocks, o, seen.rate_hz))
        if free:
            welch, leaking = _of_blocks(free, o, seen.rate_hz)
            told += welch
        told = [one for one in told if one.share.size]
        if told:
            found.append(_fact(name, told, leaking, bool(repeating)))
    return found


def _of_periods(blocks: Blocks, o: int, rate_hz: float) -> _Coherence:
    """Return which part of the output's power repeats from period to period of the same stretch, line by line."""
    y = blocks.outputs[:, :, o]
    played = excited(np.mean(np.abs(blocks.inputs) ** 2, axis=0))
    steady, total = np.zeros(y.shape[1]), np.zeros(y.shape[1])
    for i in np.unique(blocks.stretch):
        own = y[blocks.stretch == i]
        p = own.shape[0]
        power = np.mean(np.abs(own) ** 2, axis=0)
        noise = (power - np.abs(own.mean(axis=0)) ** 2) * p / max(p - 1, 1) if p > 1 else np.zeros_like(power)
        steady += p * (power - noise)  # by chance below zero: the sum over lines is right
        total += p * power
    return _at(blocks.frequency_hz(rate_hz), played & (total > 0.0), steady, total)


def _of_blocks(stretches: Sequence[Stretch], o: int, rate_hz: float) -> tuple[list[_Coherence], bool]:
    """Return the coherence from blocks as long as the averages allow, and whether leakage decides on it."""
    wanted = AVERAGES * (stretches[0].inputs.shape[1] + 1)
    length = LONGEST
    while length > SHORTEST and sum(max(2 * s.rows // length - 1, 0) for s in stretches) < wanted:
        length //= 2
    long, short = (_multiple(windowed_blocks(stretches, n), o, rate_hz) for n in (length, length // 2))
    if long is None or short is None:
        return [], False
    return [long], (1.0 - short.explained) > LEAKS * (1.0 - long.explained)


def _multiple(blocks: Blocks | None, o: int, rate_hz: float) -> _Coherence | None:
    if blocks is None:
        return None
    u, y = blocks.inputs, blocks.outputs[:, :, o]
    b, _, n_u = u.shape
    averages = b / (1.0 + OVERLAP * (1.0 - 1.0 / b))
    if averages <= n_u + 1:
        return None
    power_u = np.mean(np.abs(u) ** 2, axis=0)
    played = excited(power_u)
    scale = np.sqrt(np.maximum(power_u, np.finfo(float).tiny))
    scaled = (u / scale)[:, played]
    suu = np.einsum("bfi,bfj->fij", scaled.conj(), scaled) / b + 1e-9 * np.eye(n_u)
    suy = np.einsum("bfi,bf->fi", scaled.conj(), y[:, played]) / b
    total = np.mean(np.abs(y[:, played]) ** 2, axis=0)
    steady = np.real(np.einsum("fi,fi->f", suy.conj(), np.linalg.solve(suu, suy[..., None])[..., 0]))
    # so many inputs explain their part of so few averages by chance
    share = 1.0 - (1.0 - steady / np.maximum(total, np.finfo(float).tiny)) * averages / (averages - n_u)
    full = np.zeros(played.size), np.zeros(played.size)
    full[0][played], full[1][played] = share * total, total
    return _at(blocks.frequency_hz(rate_hz), played & (full[1] > 0.0), *full)


def _at(frequency_hz: Array, lines: NDArray[np.bool_], steady: Array, total: Array) -> _Coherence:
    return _Coherence(frequency_hz[lines], steady[lines], total[lines])


def _fact(name: str, told: Sequence[_Coherence], leaking: bool, repeating: bool) -> Fact:
    share = np.concatenate([one.share for one in told])
    frequency_hz = np.concatenate([one.frequency_hz for one in told])
    worst = int(np.argmin(share))
    low = float(np.mean(share < LOW))
    explained = min(one.explained for one in told)
    text = (
        f"of {name} the inputs explain {100.0 * explained:.1f} % of the power at {share.size} excited lines; at "
        f"{100.0 * low:.1f} % of them less than {100.0 * LOW:.0f} %, least {100.0 * share[worst]:.0f} % at "
        f"{frequency_hz[worst]:.4g} Hz"
    )
    numbers = {
        "explained": explained,
        "low": low,
        "lowest": float(share[worst]),
        "lowest_hz": float(frequency_hz[worst]),
        "lines": int(share.size),
        "repeats": int(repeating),
    }
    poor = explained < LOW and not leaking
    means = ""
    if poor:
        means = "the rest is noise, a disturbance or an input that was not recorded" + (
            "" if repeating else ", or the bench is not linear, or rings for longer than the blocks that were averaged"
        )
    elif leaking and explained < LOW:
        means = "blocks are too short for what rings: that much at least is explained"
    bands = lowest_of([shares_of(one.frequency_hz, one.steady, one.total) for one in told])
    return Fact(NAME, text, means, name, numbers=numbers, remark=poor, bands=bands)
