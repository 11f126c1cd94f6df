"""Whether stretches that follow one another in a log were one recording: what moves goes on where one ends.

A map joins files in the order of its parts, whether one recording was cut into them or each was made by itself. What
goes on by itself distinguishes the two: a drift, a hum, a coil that warms up, the motion with which a part begins.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from campaigns.facts import missing
from campaigns.facts.base import Array, Fact, Seen
from campaigns.facts.stretches import Stretch

Ints = NDArray[np.intp]

NAME = "unbroken"

CHANCE = 0.01
"""Chance at which recordings of their own would fit together so well: as sure as a cause is named."""

AHEAD = (1, 4, 16, 64)
"""Samples after a border whose means are predicted: the nearest give the position of a motion, the next its rate."""

BEHIND = 8
"""Means of readings and commands before a sample that a learnt prediction uses, of half the samples ahead each."""

COMMANDS = 4
"""Means of the commands in the samples that are predicted."""

LEAST = 16
"""Times that the samples ahead fit into a stretch, at least."""

LOOKED_AT = 8192
"""Samples on either side of a border that are looked at."""

LEARNT_FROM = 1500
"""Samples, evenly chosen from both stretches, from which the prediction is learnt."""

ENOUGH = 3
"""Times that these are more than the numbers to learn, at least."""

PLACES = 512
"""Samples of each of two stretches that are compared."""

RESTS = 0.2
"""An output that moves less than this part of what is usual on either side of a border rests there, and fits always."""

WINDOWS = 50
"""Parts of a stretch by which its usual motion is known."""

SAME = 0.25
"""Difference of what is played, as rms against its size, below which a stretch repeats the one before."""


def facts(seen: Seen, stretches: Sequence[Stretch], known: Sequence[Fact]) -> list[Fact]:
    """Return for each stretch that begins where another ends whether it goes on with the same recording."""
    inputs, outputs = (list(seen.of_role(role).values()) for role in ("input", "output"))
    followed = [(a, b) for a, b in pairwise(stretches) if a.start + a.rows == b.start]
    drawn_over = any(fact.name == missing.NAME for fact in known)  # straight lines fit to anything
    return [_fact(a, b, 1.0 if drawn_over else _chance(inputs, outputs, a, b)) for a, b in followed]


def _fact(before: Stretch, after: Stretch, chance: float) -> Fact:
    one = chance <= CHANCE
    numbers = {"start": after.start, "found": float(one), "chance": chance}
    if not one:
        text = f"the data do not show whether '{before.label}' and '{after.label}' are one recording"
        return Fact(NAME, text, segment=after.label, numbers=numbers, remark=False)
    text = f"'{before.label}' and '{after.label}' are one recording: what moves goes on from one to the other"
    means = f"recordings of their own would fit together so well with a chance of {chance:.1g}"
    return Fact(NAME, text, means, segment=after.label, numbers=numbers, remark=False)


def _chance(inputs: Sequence[Array], outputs: Sequence[Array], before: Stretch, after: Stretch) -> float:
    """Return the chance at which recordings of their own fit together as well as these; 1 where that tells nothing."""
    ahead = [m for m in AHEAD if LEAST * m <= min(before.rows, after.rows)]
    if not ahead or _repeated(inputs, before, after):
        return 1.0
    at = min(before.rows, LOOKED_AT)
    rows = slice(after.start - at, after.start + min(after.rows, LOOKED_AT))
    y = [values[rows] for values in outputs if _moves(values[rows], at)]
    if not y:
        return 1.0
    border = _Border(_sized([u[rows] for u in inputs if np.ptp(u[rows]) > 0.0], rows), _sized(y, rows), at)
    least = 1.0
    for way in (_by_its_way, _learnt):
        told = [told for m in ahead for told in way(border, m)]
        least = min(least, _coincidence(border, told))
        if 2.0 * least <= CHANCE:
            break
    return min(1.0, 2.0 * least)  # the better one of two


def _repeated(inputs: Sequence[Array], before: Stretch, after: Stretch) -> bool:
    """Tell whether a stretch plays what was played at the beginning or end of the one before, at about that level.

    A motion that has come to repeat then fits in any case, as does one that begins as the one before has.
    """
    rows = before.period if before.period and before.period == after.period else min(before.rows, after.rows)
    begun = slice(after.start, after.start + rows)
    others = slice(before.start, before.start + rows), slice(after.start - rows, after.start)
    moving = [u for u in inputs if np.ptp(u[others[1]]) > 0.0]
    return bool(moving) and any(
        all(float(np.sqrt(np.mean((u[begun] - u[other]) ** 2))) <= SAME * float(np.std(u[other])) for u in moving)
        for other in others
    )


def _moves(y: Array, at: int) -> bool:
    """Tell whether an output (n,) moves on both sides of the border at sample `at`, as much as it usually does."""
    beside, usual = [], []
    for side in (y[:at][::-1], y[at:]):
        rows = max(side.size // WINDOWS, min(16, side.size // 2))
        parts = side[: side.size // rows * rows].reshape(-1, rows).std(axis=1)
        beside.append(float(parts[0]))
        usual.append(float(np.median(parts)))
    return min(beside) > RESTS * max(usual) > 0.0


def _sized(columns: Sequence[Array], rows: slice) -> Array:
    """Return columns (n,) less the line through each, of size one, (n, k): a slow drift goes through both stretches."""
    time = np.linspace(-1.0, 1.0, rows.stop - rows.start)
    lines = np.stack([np.ones_like(time), time], axis=1)
    out = np.empty((time.size, len(columns)))
    for k, values in enumerate(columns):
        out[:, k] = values - lines @ np.linalg.lstsq(lines, values, rcond=None)[0]
    return out / np.maximum(np.std(out, axis=0), np.finfo(float).tiny)


@dataclass(frozen=True)
class _Foretold:
    """The prediction of the samples after each sample (n,) from earlier ones, the outcome, and the rms difference.

    That is of samples whose surroundings are within one stretch. The effect of later commands is subtracted. Where
    samples lie beyond both stretches there is no number.
    """

    foretold: Array
    come: Array
    usual: float

    def apart(self, ends: Ints, begins: Ints) -> Array:
        """Return how badly the samples from `begins` on go on from those before `ends`, (ends, begins)."""
        return np.asarray(np.abs(self.come[begins][None] - self.foretold[ends][:, None]) / self.usual)


@dataclass(frozen=True)
class _Border:
    """Inputs (n, n_u) and outputs (n, n_y) of two stretches, the second of which begins at sample `at`."""

    u: Array
    y: Array
    at: int

    def aligned(self, foretold: Array, come: Array, behind: int, ahead: int) -> _Foretold | None:
        """Return a prediction and its outcome, of all samples with so many behind and ahead; None where it is exact."""
        rows = np.arange(behind, behind + come.size)
        within = (rows <= self.at - ahead) | (rows >= self.at + behind)
        usual = float(np.sqrt(np.mean((come - foretold)[within] ** 2)))
        both = np.full((2, self.y.shape[0] + 1), np.nan)
        both[:, rows] = foretold, come
        return _Foretold(both[0], both[1], usual) if usual > 0.0 else None


def _coincidence(border: _Border, told: Sequence[_Foretold]) -> float:
    """Return what part of other beginnings and ends would have fitted together as well as those at the border do.

    Of pairs of any, and of this beginning with any end and the other way round: the largest. What begins at rest is
    nearer to most states than those are to each other.
    """
    known = [np.flatnonzero(np.isfinite(t.come) & np.isfinite(t.foretold)) for t in told]
    if not known:
        return 1.0
    ends = np.linspace(max(k[0] for k in known), border.at, PLACES).astype(np.intp)
    begins = np.linspace(border.at, min(k[-1] for k in known), PLACES).astype(np.intp)
    worst = np.max([t.apart(ends, begins) for t in told], axis=0)
    fit = worst <= worst[-1, 0]
    return float(max(fit.mean(), fit[:, 0].mean(), fit[-1].mean()))


def _by_its_way(border: _Border, m: int) -> Iterator[_Foretold]:
    """Yield the mean of the next `m` samples, predicted by the better of line and parabola through the last 2 m."""
    for y in border.y.T:
        come = np.convolve(y, np.full(m, 1.0 / m), mode="valid")[2 * m :]
        found = []
        for degree in (0, 1, 2) if m > 1 else (0, 1):
            before, after = np.vander(np.arange(-2 * m, 0) / m, degree + 1), np.vander(np.arange(m) / m, degree + 1)
            weights = after.mean(axis=0) @ np.linalg.pinv(before)
            foretold = np.convolve(y, weights[::-1], mode="valid")[: come.size]
            found.append(border.aligned(foretold, come, 2 * m, m))
        yield from sorted(filter(None, found), key=lambda one: one.usual)[:1]


def _learnt(border: _Border, m: int) -> Iterator[_Foretold]:
    """Yield both halves of the next `m` samples from a linear prediction that uses the commands as well."""
    half, n = max(m // 2, 1), border.y.shape[0]
    behind = BEHIND * half
    rows = np.arange(behind, n - m + 1)
    past = np.hstack([_means(np.hstack([border.y, border.u]), rows - behind, BEHIND, half), np.ones((rows.size, 1))])
    parts = min(m, COMMANDS)
    future, target = _means(border.u, rows, parts, m // parts), _means(border.y, rows, m // half, half)
    within = np.flatnonzero((rows <= border.at - m) | (rows >= border.at + behind))
    some = within[np.linspace(0, within.size - 1, min(LEARNT_FROM, within.size)).astype(np.intp)]
    if some.size < ENOUGH * (past.shape[1] + future.shape[1]):
        return
    weights = np.linalg.lstsq(np.hstack([past, future])[some], target[some], rcond=None)[0]
    foretold, come = past @ weights[: past.shape[1]], target - future @ weights[past.shape[1] :]
    yield from filter(None, (border.aligned(*both, behind, m) for both in zip(foretold.T, come.T, strict=True)))


def _means(values: Array, rows: Ints, count: int, width: int) -> Array:
    """Return the means of `count` adjacent parts of `values` (n, k), each of `width` samples, from each of `rows` on.

    Shape (samples, count k).
    """
    total = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    edges = rows[:, None] + width * np.arange(count + 1)
    return np.asarray(np.diff(total[edges], axis=1).reshape(rows.size, -1) / width)
