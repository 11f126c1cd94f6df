"""Screening in the space of inner products: one pass over the data, then every hypothesis costs microseconds.

All columns (residual, nuisances, candidates) are whitened, the unknown start of each record is projected out, and their
inner products are collected. The likelihood ratio of any set of candidates is then a small linear solve, with the
nuisances adjusted jointly under their prior every time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy
from numpy.typing import NDArray

from sim_backend.effects.view import LEAST_PART
from sim_backend.linear import Array

Ints = NDArray[np.int64]

COLLINEAR = 1e-4
"""Tolerance 1 − R² (part of its energy, nuisances projected out) below which a candidate is collinear with these."""

_ROUNDING = 1e-14
"""Relative rounding of an inner product after projection: some tens of operations on numbers of 1e-16."""


@dataclass(frozen=True)
class Gram:
    """Inner products of whitened columns: residual first, then `n_nuisances` nuisances, then the candidates' columns.

    `products` (1 + n_nuisances + n_columns)²; `groups` lists each candidate's columns; `one_sided` tells which can only
    be positive; `rows` counts the samples. A small part of a candidate that is `whole` does not count.
    `by_output` (n_y, 1 + n_nuisances + n_columns) is how the squares of the columns share out over the outputs.
    """

    products: Array
    n_nuisances: int
    groups: tuple[Ints, ...]
    one_sided: tuple[bool, ...]
    rows: int
    known_noise: bool
    whole: tuple[bool, ...] = ()
    by_output: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def without(self, columns: Ints) -> Array:
        """Return the products (n, n) after the given columns (k,) are projected out (Schur complement)."""
        if columns.size == 0:
            return self.products
        g = self.products
        inner = g[np.ix_(columns, columns)]
        scale = np.sqrt(np.maximum(np.diag(inner), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(inner / np.outer(scale, scale))
        # a direction below rounding cannot be projected out, and must not be: it would add noise of any size
        live = values > 1e-14 * values[-1]
        cross = (vectors[:, live] / np.sqrt(values[live])).T @ (g[columns] / scale[:, None])
        return np.asarray(g - cross.T @ cross, dtype=float)

    def shares(self, group: int) -> Array:
        """Return the part (n_y,) of a candidate's energy that is in each output; nothing where that is not known."""
        energy = np.sum(self.by_output[:, self.groups[group]], axis=1) if self.by_output.size else np.zeros(0)
        return np.asarray(energy / max(float(np.sum(energy)), 1e-300))

    def nuisance_columns(self) -> Ints:
        """Return the column numbers (n_nuisances,) of the nuisances."""
        return np.arange(1, 1 + self.n_nuisances)

    def ratios(self, drops: Array, remaining: float) -> Array:
        """Return twice the log-likelihood ratios of what lowers the sum of squares `remaining` by `drops` (n,).

        With known noise that is the drop itself, else samples · log(before/after).
        """
        if self.known_noise:
            return drops
        return np.asarray(self.rows * -np.log1p(-np.minimum(drops / remaining, 1.0 - 1e-12)), dtype=float)

    def solve(self, reduced: Array, together: Sequence[int]) -> tuple[float, Array]:
        """Return by how much the candidates numbered `together` lower the sum of squares, and their sizes (n_columns,).

        Sizes are in units of the candidates' columns, one candidate after the other.

        Sizes that cannot be negative are kept from it. Directions whose tolerance after projection is below one part in
        10¹¹ are rounding and count as nothing.
        """
        columns = np.concatenate([self.groups[i] for i in together])
        if self.whole and len(together) == 1 and self.whole[together[0]]:
            seen, energy = float(reduced[columns[0], 0]), max(float(reduced[columns[0], columns[0]]), 1e-300)
            part = min(max(seen / energy, LEAST_PART), 1.0)
            drop = part * (2.0 * seen - part * energy)
            return (drop, np.full(1, part)) if drop > 0.0 else (0.0, np.zeros(1))
        own = reduced[np.ix_(columns, columns)]
        left = np.maximum(np.diag(own), 0.0)
        live = np.flatnonzero(np.isin(columns, self._live(reduced, columns)))
        sizes = np.zeros(columns.size)
        if not live.size:
            return 0.0, sizes
        scale = np.sqrt(left[live])
        basis = own[np.ix_(live, live)] / np.outer(scale, scale) + self._ridge(reduced, columns[live])
        r = reduced[columns[live], 0] / scale
        if all(self.one_sided[i] for i in together):
            x, basis = _not_negative(basis, r)
        else:
            x = np.linalg.solve(basis, r)
        sizes[live] = x / scale
        return float(2.0 * r @ x - x @ basis @ x), sizes

    def _live(self, reduced: Array, columns: Ints) -> Ints:
        """Return those of `columns` whose tolerance after projection is above rounding."""
        before = np.maximum(np.diag(self.products)[columns], np.finfo(float).tiny)
        return columns[np.diag(reduced)[columns] > 1e-11 * before]

    def fresh(self, reduced: Array, columns: Ints, least: float) -> tuple[float, int]:
        """Return by how much the independent part of `columns` (k,) lowers the sum of squares; in how many directions.

        Directions whose tolerance 1 − R² after projection exceeds `least` are independent. A column that is closer to
        collinear with the nuisances gains by its difference from their best fit: by noise in the motion it was made
        from, and by the error of a derivative.
        """
        if not columns.size:
            return 0.0, 0
        before = self.products[np.ix_(columns, columns)]
        scale = np.sqrt(np.maximum(np.diag(before), np.finfo(float).tiny))
        values, vectors = np.linalg.eigh(before / np.outer(scale, scale))
        there = values > 1e-8 * max(values[-1], np.finfo(float).tiny)
        basis = vectors[:, there] / np.sqrt(values[there]) / scale[:, None]
        left, ways = np.linalg.eigh(basis.T @ reduced[np.ix_(columns, columns)] @ basis)
        kept = left > least
        parts = (basis @ ways[:, kept]).T @ reduced[columns, 0]
        return float(np.sum(parts**2 / left[kept])), int(kept.sum())

    def _ridge(self, reduced: Array, columns: Ints) -> Array:
        """Return what is added to the normalised products of `columns` (n, n) so that rounding leaves them positive.

        The products after projection have the rounding of those before.
        """
        left = np.diag(reduced)[columns] / np.diag(self.products)[columns]
        return np.asarray(np.diag(1e-9 + _ROUNDING / left))

    def nuisances_beside(self, together: Sequence[int], sizes: Array) -> Array:
        """Return the change (n_nuisances,) of the nuisances that goes with these candidates at `sizes`."""
        nuisances, columns = self.nuisance_columns(), np.concatenate([self.groups[i] for i in together])
        g = self.products
        inner = g[np.ix_(nuisances, nuisances)]
        scale = np.sqrt(np.maximum(np.diag(inner), np.finfo(float).tiny))
        wanted = g[nuisances, 0] - g[np.ix_(nuisances, columns)] @ sizes
        return np.asarray(np.linalg.lstsq(inner / np.outer(scale, scale), wanted / scale, rcond=1e-14)[0] / scale)

    def tolerance(self, reduced: Array) -> Array:
        """Return the tolerance (candidates,) of the strongest column of each beside the nuisances, from 0 to 1."""
        before, left = np.diag(self.products), np.diag(reduced)
        return np.array([np.max(left[c] / np.maximum(before[c], np.finfo(float).tiny)) for c in self.groups])

    def seen(self, reduced: Array, group: int, ratio: float) -> Array:
        """Return the sizes (n_columns of the group,) that give this `ratio` in half of all cases, each by itself.

        In units of the columns, with the nuisances adjusted beside each; infinite for one that they absorb wholly.
        """
        columns, remaining = self.groups[group], float(reduced[0, 0])
        drop = ratio if self.known_noise else -remaining * np.expm1(-ratio / self.rows)
        there = np.isin(columns, self._live(reduced, columns))
        energy = np.where(there, np.diag(reduced)[columns], np.nan)
        return np.where(there, np.sqrt(drop / energy), np.inf)

    def null_ratios(self, reduced: Array, rng: np.random.Generator, draws: int) -> Array:
        """Return every candidate's ratio in `draws` simulated noise-only data sets, shape (n_candidates, draws).

        Columns that are only rounding after projection are left out, as in `solve`.
        """
        groups = [self._live(reduced, columns) for columns in self.groups]
        ratios = np.zeros((len(groups), draws))
        if not any(g.size for g in groups):
            return ratios
        used = np.unique(np.concatenate(groups))
        scale = np.sqrt(np.diag(reduced)[used])
        correlation = reduced[np.ix_(used, used)] / np.outer(scale, scale)
        values, vectors = np.linalg.eigh(correlation)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        z = root @ rng.standard_normal((used.size, draws))
        position = {int(c): i for i, c in enumerate(used)}
        for i, columns in enumerate(groups):
            if not columns.size:
                continue
            rows = [position[int(c)] for c in columns]
            inner = correlation[np.ix_(rows, rows)] + self._ridge(reduced, columns)
            part = z[rows]
            ratios[i] = np.einsum("id,id->d", part, np.linalg.solve(inner, part))
        return ratios


def beside_start(products: Array, seen: Array) -> Array:
    """Return products (n, n) without what of each column lies along an unknown start; `seen` (n_start, n) is that.

    A column that is a start itself, and nothing else, would leave its rounding, of either sign: it leaves zero.
    """
    left = products - seen.T @ seen
    # of thousands of samples the sums round by more: up to 1.4e-14 of the energy was left of such columns in a campaign
    nothing = np.diag(left) <= 10.0 * _ROUNDING * np.diag(products)
    left[nothing], left[:, nothing] = 0.0, 0.0
    return left


def _not_negative(basis: Array, r: Array) -> tuple[Array, Array]:
    """Return x (n,) of which none is negative where 2 r x - x basis x is largest, and the `basis` (n, n) it is of.

    Beside a motion that grows without end rounding may leave more than the columns differ by: directions without
    energy count as nothing.
    """
    try:
        root = np.linalg.cholesky(basis)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(basis)
        there = values > 1e-6 * values[-1]
        root = vectors[:, there] * np.sqrt(values[there])
        x, _ = scipy.optimize.nnls(root.T, vectors[:, there].T @ r / np.sqrt(values[there]))
        return x, root @ root.T
    x, _ = scipy.optimize.nnls(root.T, np.linalg.solve(root, r))
    return x, basis
