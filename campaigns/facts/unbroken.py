"""Whether stretches that follow one another in a log were one recording: what moves goes on where one ends.

A map joins files in the order of its parts, whether one recording was cut into them or each was made by itself. What
goes on by itself tells the two apart: a drift, a hum, a coil that warms up, the motion with which a part begins.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.base import Array, Fact, Seen
from campaigns.facts.stretches import Stretch

Ints = NDArray[np.intp]

NAME = "unbroken"

CHANCE = 0.01
"""Chance at which recordings of their own would fit together so well: as sure as a cause is named."""

AHEAD = (1, 4, 16, 64)
"""Rows after a border whose means are foretold: close by they tell where a motion is, further on its way."""

BEHIND = 8
"""Means of readings and commands that a learnt prediction knows, each over half as many rows as it foretells."""

COMMANDS = 4
"""Means of the commands in the rows that are foretold."""

LEAST = 16
"""Times that the rows ahead fit into a stretch, at least."""

LOOKED_AT = 8192
"""Rows on either side of a border that are looked at."""

LEARNT_FROM = 1500
"""Rows, spread over both stretches, from which it is learnt how to foretell."""

PLACES = 256
"""Rows of each of two stretches that are held against each other."""

COUNTED = 10
"""Pairs of rows that fit by chance, below which their number says no more than that they are few."""

RESTS = 0.2
"""What moves less than this part of its usual motion on either side of a border rests there: it fits in any case."""

WINDOWS = 50
"""Parts of a stretch by which its usual motion is known."""

SAME = 0.1
"""What inputs may differ by, against their size, for a stretch to go on as the one before would have."""


def facts(seen: Seen, stretches: Sequence[Stretch], known: Sequence[Fact]) -> list[Fact]:
    """Return for each stretch that begins where another ends whether it goes on with the same recording."""
    inputs, outputs = (list(seen.of_role(role).values()) for role in ("input", "output"))
    followed = [(a, b) for a, b in pairwise(stretches) if a.start + a.rows == b.start]
    return [_fact(a, b, _chance(inputs, outputs, a, b)) for a, b in followed]


def _fact(before: Stretch, after: Stretch, chance: float) -> Fact:
    one = chance <= CHANCE
    numbers = {"start": after.start, "found": float(one), "chance": chance}
    if not one:
        text = f"whether this and '{before.label}' are one recording cannot be told from what is read"
        return Fact(NAME, text, segment=after.label, numbers=numbers, remark=False)
    text = f"this and '{before.label}' are one recording: what moves goes on from one to the other"
    means = f"recordings of their own would fit together so well with a chance of {chance:.1g}"
    return Fact(NAME, text, means, segment=after.label, numbers=numbers, remark=False)


def _chance(inputs: Sequence[Array], outputs: Sequence[Array], before: Stretch, after: Stretch) -> float:
    """Return the chance at which recordings of their own fit together as well as these; 1 where that tells nothing."""
    ahead = [m for m in AHEAD if LEAST * m <= min(before.rows, after.rows)]
    first, last = max(before.start, after.start - LOOKED_AT), min(after.start + after.rows, after.start + LOOKED_AT)
    u, y = (_sized([column[first:last] for column in columns]) for columns in (inputs, outputs))
    border = _Border(u, y, after.start - first)
    if not ahead or _repeated(u, border.at, before, after) or not border.moves():
        return 1.0
    ways = [[told for m in ahead for told in way(border, m)] for way in (_by_its_way, _learnt)]
    return min(1.0, len(ways) * min(_coincidence(border, told) for told in ways))


def _sized(columns: Sequence[Array]) -> Array:
    """Return columns (n,) of size one without their means, (n, k); what never moves is left out."""
    moving = [(values - values.mean()) / values.std() for values in columns if np.ptp(values) > 0.0]
    return np.stack(moving, axis=1) if moving else np.empty((columns[0].size if columns else 0, 0))


def _repeated(u: Array, at: int, before: Stretch, after: Stretch) -> bool:
    """Tell whether both stretches repeat the same period: then a motion that has come to repeat fits in any case."""
    period = before.period
    if not period or after.period != period or period > min(at, u.shape[0] - at):
        return False
    ended, begun = u[at - period : at], u[at : at + period]
    return bool(np.all(np.max(np.abs(ended - begun), axis=0) <= SAME * np.std(ended, axis=0)))


@dataclass(frozen=True)
class _Foretold:
    """What earlier rows foretell of the rows after each row (n,), what comes, and the rms between both within.

    What later commands add is taken off what comes. Where rows reach beyond both stretches there is no number.
    """

    foretold: Array
    come: Array
    usual: float

    def apart(self, ends: Ints, begins: Ints) -> Array:
        """Return how badly the rows from `begins` on go on from those before `ends`, (ends, begins)."""
        return np.asarray(np.abs(self.come[begins][None] - self.foretold[ends][:, None]) / self.usual)


@dataclass(frozen=True)
class _Border:
    """Inputs (n, n_u) and outputs (n, n_y) of two stretches, the second of which begins at row `at`."""

    u: Array
    y: Array
    at: int

    def moves(self) -> bool:
        """Tell whether an output moves on both sides of the border."""
        return any(_moves(y[: self.at][::-1]) and _moves(y[self.at :]) for y in self.y.T)

    def foretold(self, foretold: Array, come: Array, behind: int, ahead: int) -> _Foretold | None:
        """Return both, known from so many rows behind and ahead (n - behind - ahead + 1,); None of what is exact."""
        rows = np.arange(behind, behind + come.size)
        within = (rows <= self.at - ahead) | (rows >= self.at + behind)
        usual = float(np.sqrt(np.mean((come - foretold)[within] ** 2)))
        both = np.full((2, self.y.shape[0] + 1), np.nan)
        both[:, rows] = foretold, come
        return _Foretold(both[0], both[1], usual) if usual > 0.0 else None


def _coincidence(border: _Border, told: Sequence[_Foretold]) -> float:
    """Return what part of pairs of rows, one of each stretch, would have fitted together as well as the border does."""
    known = [np.flatnonzero(np.isfinite(t.come) & np.isfinite(t.foretold)) for t in told]
    if not known:
        return 1.0
    ends = np.linspace(max(k[0] for k in known), border.at, PLACES).astype(np.intp)
    begins = np.linspace(border.at, min(k[-1] for k in known), PLACES).astype(np.intp)
    here = np.array([border.at])
    limit = max(float(t.apart(here, here)[0, 0]) for t in told)
    fit = np.ones((PLACES, PLACES), dtype=bool)
    for t in told:
        fit &= t.apart(ends, begins) <= limit
    return max(int(np.count_nonzero(fit)), COUNTED) / PLACES**2


def _by_its_way(border: _Border, m: int) -> Iterator[_Foretold]:
    """Yield the mean of the next `m` rows, foretold by the line or parabola through the last 2 m that misses less."""
    for y in border.y.T:
        come = np.convolve(y, np.full(m, 1.0 / m), mode="valid")[2 * m :]
        found = []
        for degree in (0, 1, 2) if m > 1 else (0, 1):
            before, after = np.vander(np.arange(-2 * m, 0) / m, degree + 1), np.vander(np.arange(m) / m, degree + 1)
            weights = after.mean(axis=0) @ np.linalg.pinv(before)
            foretold = np.convolve(y, weights[::-1], mode="valid")[: come.size]
            found.append(border.foretold(foretold, come, 2 * m, m))
        yield from sorted(filter(None, found), key=lambda one: one.usual)[:1]


def _learnt(border: _Border, m: int) -> Iterator[_Foretold]:
    """Yield both halves of the next `m` rows, foretold by a linear prediction that knows the commands as well."""
    half, n = max(m // 2, 1), border.y.shape[0]
    behind = BEHIND * half
    rows = np.arange(behind, n - m + 1)
    past = np.hstack([_means(np.hstack([border.y, border.u]), rows - behind, BEHIND, half), np.ones((rows.size, 1))])
    parts = min(m, COMMANDS)
    future, target = _means(border.u, rows, parts, m // parts), _means(border.y, rows, m // half, half)
    within = np.flatnonzero((rows <= border.at - m) | (rows >= border.at + behind))
    if within.size < 3 * (past.shape[1] + future.shape[1]):
        return
    some = within[np.linspace(0, within.size - 1, min(LEARNT_FROM, within.size)).astype(np.intp)]
    weights = np.linalg.lstsq(np.hstack([past, future])[some], target[some], rcond=None)[0]
    foretold, come = past @ weights[: past.shape[1]], target - future @ weights[past.shape[1] :]
    yield from filter(None, (border.foretold(*both, behind, m) for both in zip(foretold.T, come.T, strict=True)))


def _means(values: Array, rows: Ints, count: int, width: int) -> Array:
    """Return the means of so many neighbouring parts of `values` (n, k), each of `width` rows, from each of `rows` on.

    Shape (rows, count k).
    """
    total = np.vstack([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    edges = rows[:, None] + width * np.arange(count + 1)
    return np.asarray(np.diff(total[edges], axis=1).reshape(rows.size, -1) / width)


def _moves(y: Array) -> bool:
    """Tell whether the beginning of a stretch moves as much as it usually does."""
    rows = max(y.size // WINDOWS, min(16, y.size // 2))
    usual = y[: y.size // rows * rows].reshape(-1, rows).std(axis=1)
    return bool(usual[0] > RESTS * np.median(usual) > 0.0)
