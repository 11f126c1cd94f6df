"""Readings that repeat the last one where noise and motion make that all but impossible: samples that were lost.

Two readings a sample apart differ by δ ~ N(motion, σ²). Quantised in steps of q they are equal with probability
E[max(0, 1 - |δ| / q)], which is next to nothing where q is the last digit of a floating-point number, or where the
motion between them is many steps. Only such pairs are counted.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.records.lattice import lattice_of
from analysis.diagnosis.variance.chance import Chance
from sim_backend.effects.dropped_samples import DroppedSamples
from sim_backend.linear import Array

Mask = NDArray[np.bool_]

_IMPOSSIBLE = 1e-6
"""Pairs count that are equal by chance with less than this probability."""

MAD = 1.4826
"""Standard deviation of normal numbers over the median of their magnitudes."""

_DIGITS = 12
"""Significant digits of text, at most; numbers that need more are as fine as floating-point numbers."""

_ORDERED = 1e-4
"""Repeats that stand together, or apart, as no random loss does with more than this probability are something else: a
sensor that is stuck, or one that is read more often than it measures."""


@dataclass(frozen=True)
class Repeats:
    """How many of `pairs` are equal, how many were `expected` to be by chance, and whether they lie at random."""

    equal: int
    pairs: int
    expected: float
    random: bool
    where: tuple[Mask, ...]

    @property
    def fraction(self) -> float:
        """Share of the samples that are lost."""
        return max(self.equal - self.expected, 0.0) / max(self.pairs, 1)


def repeats_of(readings: list[Array], predicted: list[Array]) -> Repeats:
    """Return what repeats in `readings`, one (n,) per record, beside the motion `predicted` for each."""
    steps = _spacings(readings)
    moves = [np.diff(x) for x in predicted]
    left = np.concatenate([np.diff(y) - move for y, move in zip(readings, moves, strict=True)])
    sd = MAD * float(np.median(np.abs(left - np.median(left))))
    equal, pairs, expected, together, chances = 0, 0, 0.0, 0, 0
    where = []
    for y, move, step in zip(readings, moves, steps, strict=True):
        chance = _chance_of_equal(move, sd, step[:-1])
        rare = chance < _IMPOSSIBLE
        same = rare & (np.diff(y) == 0.0)
        equal, pairs, expected = equal + int(same.sum()), pairs + int(rare.sum()), expected + float(chance[rare].sum())
        together += int(np.sum(same[1:] & same[:-1]))
        chances += int(np.sum(rare[1:] & same[:-1]))
        where.append(np.concatenate([[False], same]))
    share = equal / max(pairs, 1)
    tail = 2.0 * min(scipy.special.bdtr(together, chances, share), scipy.special.bdtrc(together - 1, chances, share))
    return Repeats(equal, pairs, expected, bool(tail > _ORDERED), tuple(where))


def _spacings(readings: list[Array]) -> list[Array]:
    """Return the distance to the next value that each reading can take, (n,) per record.

    That is a quantisation step, the last of so many significant digits in which readings were written, or the last bit
    of a number.
    """
    values = np.concatenate(readings)
    lattice = lattice_of(values)
    least = lattice.step if lattice else 0.0
    digits = next((n for n in range(1, _DIGITS + 1) if _written_in(values, n)), 0)
    if digits:
        return [np.maximum(_last_digit(y, digits), least) for y in readings]
    short = bool(np.all(values.astype(np.float32) == values))
    last = float(np.spacing(np.abs(values).max().astype(np.float32 if short else np.float64)))
    return [np.full(y.size, max(least, last)) for y in readings]


def _last_digit(values: Array, digits: int) -> Array:
    """Return what the last of so many significant digits of each value counts, (n,)."""
    size = np.where(values != 0.0, np.abs(values), np.abs(values).max(initial=1.0))
    return np.asarray(10.0 ** (np.floor(np.log10(size)) - digits + 1))


def _written_in(values: Array, digits: int) -> bool:
    """Tell whether all values read back the same from so many significant digits."""
    return all(float(f"{v:.{digits - 1}e}") == v for v in values.tolist())


def _chance_of_equal(move: Array, noise: float, step: Array) -> Array:
    """Return E[max(0, 1 - |δ| / step)] for δ ~ N(move, noise²) and each `step`, shape of `move`.

    A difference of two readings is known no better than their rounding, step²/6 in variance, even where the model that
    predicts the motion rounds as well.
    """
    sd, d = np.maximum(noise, step / math.sqrt(6.0)), np.abs(move)
    narrow = step * _normal(d / sd) / sd  # the triangle is a point beside the normal curve
    a, b, c = (d - step) / sd, d / sd, (d + step) / sd
    # the triangle is a second difference of ramps, and E[max(0, δ - k)] of a normal δ is sd (pdf + z cdf)
    ramp = [_normal(z) + z * scipy.special.ndtr(z) for z in (a, b, c)]
    wide = np.clip(sd / step * (ramp[0] - 2.0 * ramp[1] + ramp[2]), 0.0, 1.0)
    return np.asarray(np.where(step < 0.01 * sd, narrow, wide))


def _normal(z: Array) -> Array:
    """Return the density of a unit normal number."""
    return np.asarray(np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi))


def lost_samples(setting: Setting, fit: Fit) -> list[Chance]:
    """Return every output of which samples were lost at random."""
    records, rows = setting.data.records, setting.rows // setting.data.n_outputs
    found = []
    for o, where in enumerate(setting.places.outputs):
        predicted = [r.y[:, o] - residual[:, o] for r, residual in zip(records, fit.residuals, strict=True)]
        seen = repeats_of([r.y[:, o] for r in records], predicted)
        if seen.fraction <= 0.0 or not seen.random:
            continue
        expected = max(seen.expected, 1e-12)
        share = seen.fraction
        power = sum(
            float(np.sum(residual[lost & r.fitted(), o] ** 2))
            for r, residual, lost in zip(records, fit.residuals, seen.where, strict=True)
        ) * float(np.sum(setting.whitener.taps[o] ** 2))
        found.append(
            Chance(
                DroppedSamples(where, fraction=min(share, 0.99)),
                {"fraction": math.sqrt(share * (1.0 - share) / seen.pairs)},
                seen.equal * math.log(seen.equal / expected) - (seen.equal - expected),
                float(scipy.special.pdtrc(seen.equal - 1, expected)),
                power / rows / setting.data.n_outputs,
                math.sqrt(power),
            )
        )
    return found
