"""One output foretold from its own past and the inputs, past and to come: a delay and a loop are read from it.

An output of order n is y(t) = Σ a_k y(t-k) + Σ b_k u(t-k) + e(t), which a high order makes of any linear system with
noise of any colour: L. Ljung, System Identification, 2nd edition, 1999, section 4.2 and (7.28).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.facts.base import Array
from campaigns.facts.stretches import Stretch

AHEAD = 10
"""Samples to come, and as many beyond the order, that are asked for what they hold of the output."""

FRESH = 1e-3
"""Part of an input's power that must be unpredictable in a sample to test what that sample alone does. Of a smooth
input, a sweep or a few frequencies, that part is less than the noise of its own sensor, 3 % of it; later samples then
show, by their mean, what the input was."""

MOST_ORDER = 40
MOST_COLUMNS = 130
MOST_ROWS = 20_000
PIECES = 4

ROUNDING = 1e-12
"""Part of a column that others leave of it by rounding alone."""

ROWS_PER_COLUMN = 5
"""Fewest samples for each number that is fitted."""


@dataclass(frozen=True)
class Regression:
    """An output on all lags: `triangle` (p + 1, p + 1) of their orthogonal form, the output in its last column.

    `lag` (p,) is that of each column, `of` (p,) the channel: -1 for the output itself, 0 and on for inputs, -2 for a
    reference. `rows` is their number of independent samples.
    """

    triangle: Array
    lag: NDArray[np.intp]
    of: NDArray[np.intp]
    rows: float
    order: int

    def left(self, columns: Sequence[NDArray[np.bool_]]) -> list[float]:
        """Return the sums of squares that the first, the first two, ... groups of columns (p,) leave of the output.

        A column that those before it hold already, or that is zero as a reference that repeats exactly, tells nothing.
        """
        chosen = np.concatenate([np.flatnonzero(group) for group in columns])
        ends = np.cumsum([int(group.sum()) for group in columns])
        kept = independent(self.triangle[:, chosen])
        tail = triangle_of(self.triangle[:, [*chosen[kept], -1]])[:, -1] ** 2
        left = np.cumsum(tail[::-1])[::-1]
        ends = np.searchsorted(kept, ends)
        return [float(left[end]) if end < left.size else 0.0 for end in ends]

    def fresh(self) -> float:
        """Return which part of the least predictable input's power is new in the next sample, given its past."""
        earlier = np.flatnonzero((self.of <= -2) | self.past | self.before)
        kept = earlier[independent(self.triangle[:, earlier])]
        parts = []
        for next_one in np.flatnonzero((self.of >= 0) & (self.lag == -1)):
            column = triangle_of(self.triangle[:, [*kept, next_one]])[:, -1] ** 2
            parts.append(float(column[-1] / max(column.sum(), np.finfo(float).tiny)))
        return max(parts)

    @property
    def past(self) -> NDArray[np.bool_]:
        """Which columns (p,) are the output's past and the inputs up to now, up to the order."""
        return (self.of > -2) & (self.lag >= 0) & (self.lag <= self.order)

    @property
    def before(self) -> NDArray[np.bool_]:
        """Which columns (p,) are inputs before the order."""
        return (self.of >= 0) & (self.lag > self.order) & (self.lag <= self.order + AHEAD)

    @property
    def after(self) -> NDArray[np.bool_]:
        """Which columns (p,) are inputs to come."""
        return (self.of >= 0) & (self.lag < 0)


def triangle_of(matrix: Array) -> Array:
    """Return the upper triangle R (p, p) of an orthogonal form Q R of a matrix (n, p)."""
    return np.asarray(np.linalg.qr(matrix, mode="r"))


def independent(matrix: Array) -> NDArray[np.intp]:
    """Return which columns of a matrix (n, p), given those before them, are no sum of others but for rounding.

    An orthogonal form without exchanges gives a dependent column a row of its own all the same, filled with whatever
    stood there: the column would seem to explain that part of all that follow.
    """
    size = np.linalg.norm(matrix, axis=0)
    kept = np.flatnonzero(size)
    while kept.size:
        own = np.abs(np.diag(triangle_of(matrix[:, kept])))
        held = np.flatnonzero(own <= ROUNDING * size[kept[: own.size]])
        if not held.size:
            return kept[: own.size]
        kept = np.delete(kept, held[0])
    return kept


def regression_of(stretches: Sequence[Stretch], output: int, *, worth: float = 1.0) -> Regression | None:
    """Return the regression of an output, of the order that the Bayesian criterion chooses; None for too few samples.

    `worth` is the part of the samples that are independent of each other.
    """
    some = _pieces(stretches)
    if not some:
        return None
    n_u, n_r = some[0].inputs.shape[1], some[0].references.shape[1]
    rows = sum(s.rows for s in some)
    most = int(min(MOST_COLUMNS, worth * rows / ROWS_PER_COLUMN))
    spare = AHEAD * 2 * n_u + n_r * (AHEAD + 1)
    highest = min(MOST_ORDER, (most - spare) // (1 + n_u + n_r))
    if highest < 2:
        return None
    lag, of = _columns(highest, n_u, n_r)
    triangle: Array = np.zeros((0, lag.size + 1))
    used = 0
    for s in some:
        matrix = _matrix(s, output, lag, of, highest + AHEAD)
        used += matrix.shape[0]
        triangle = triangle_of(np.concatenate([triangle, matrix]))
    if triangle.shape[0] < triangle.shape[1] or not triangle[-1, -1]:
        return None
    found = Regression(triangle, lag, of, worth * used, highest)
    orders = range(1, highest + 1)
    by_lag = [(of > -2) & (lag >= 0) & (lag <= 1)] + [(of > -2) & (lag == n) for n in orders[1:]]
    sizes = np.cumsum([int(group.sum()) for group in by_lag])
    left = np.maximum(found.left(by_lag), np.finfo(float).tiny)
    criterion = worth * used * np.log(left) + sizes * math.log(worth * used)
    return Regression(triangle, lag, of, worth * used, orders[int(np.argmin(criterion))])


def _pieces(stretches: Sequence[Stretch]) -> list[Stretch]:
    """Return all samples, or so many as are looked at in pieces spread over those there are."""
    least = MOST_ORDER + 2 * AHEAD + 1
    enough = [s for s in stretches if s.rows >= 2 * least]
    total = sum(s.rows for s in enough)
    if total <= MOST_ROWS:
        return enough
    size = MOST_ROWS // PIECES
    starts = np.cumsum([0] + [s.rows for s in enough])
    pieces = []
    for at in np.linspace(0, total - 1, PIECES):
        i = min(int(np.searchsorted(starts, at, side="right")) - 1, len(enough) - 1)
        s = enough[i]
        first = int(np.clip(at - starts[i] - size // 2, 0, max(s.rows - size, 0)))
        rows = slice(first, first + size)
        pieces.append(Stretch(s.label, s.start + first, s.inputs[rows], s.outputs[rows], s.references[rows], 0))
    return pieces


def _columns(order: int, n_u: int, n_r: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return lag and channel of every column: by lag, each order before the next; then what is beside."""
    past = [(k, j) for k in range(order + 1) for j in range(-1, n_u) if k or j >= 0]
    past += [(k, j) for k in range(order + 1, order + AHEAD + 1) for j in range(n_u)]
    references = [(k, -2 - j) for j in range(n_r) for k in range(-AHEAD, order + 1)]
    ahead = [(-k, j) for k in range(1, AHEAD + 1) for j in range(n_u)]
    lag, of = np.array(past + references + ahead).T
    return lag, of


def _matrix(s: Stretch, output: int, lag: NDArray[np.intp], of: NDArray[np.intp], deepest: int) -> Array:
    """Return the columns and the output for every sample that has all of them, without their means."""
    rows = np.arange(deepest, s.rows - AHEAD)
    out = np.empty((rows.size, lag.size + 1))
    for c, (k, j) in enumerate(zip(lag, of, strict=True)):
        column = s.outputs[:, output] if j == -1 else s.inputs[:, j] if j >= 0 else s.references[:, -2 - j]
        out[:, c] = column[deepest - k : s.rows - AHEAD - k]
    out[:, -1] = s.outputs[deepest : s.rows - AHEAD, output]
    return out - out.mean(axis=0)
