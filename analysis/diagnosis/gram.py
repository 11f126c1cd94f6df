"""Screening in the space of inner products: one pass over the data, then every hypothesis costs microseconds.

All columns (residual, knobs, candidates) are whitened, the unknown start of each record is projected out, and their inner products
are collected. The likelihood ratio of any set of candidates is then a small linear solve, the knobs being re-tuned
jointly under their prior every time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gram:
    """Inner products of whitened columns: residual first, then `n_knobs` knobs, then the candidates' columns.

    `products` (1 + n_knobs + n_columns)²; `groups` lists each candidate's columns; `rows` counts the samples.
    """

    products: Array
    n_knobs: int
    groups: tuple[Array, ...]
    rows: int
    known_noise: bool

    def without(self, columns: Array) -> Array:
        """Return the products of what is left after the given columns are projected out (Schur complement)."""
        if columns.size == 0:
            return self.products
        g = self.products
        inner = g[np.ix_(columns, columns)]
        scale = np.sqrt(np.maximum(np.diag(inner), np.finfo(float).tiny))
        basis = inner / np.outer(scale, scale) + 1e-10 * np.eye(columns.size)
        cross = g[columns] / scale[:, None]
        return np.asarray(g - cross.T @ np.linalg.solve(basis, cross), dtype=float)

    def knob_columns(self) -> Array:
        """Return the column numbers of the knobs."""
        return np.arange(1, 1 + self.n_knobs)

    def gains(self, reduced: Array, remaining: float) -> Array:
        """Return, per candidate, twice the log-likelihood ratio of adding it, from reduced products.

        `remaining` is the residual sum of squares before. With known noise that ratio is the drop itself, else it is
        rows · log(before/after).
        """
        drops = np.array([_drop(reduced, columns) for columns in self.groups])
        if self.known_noise:
            return drops
        return np.asarray(self.rows * -np.log1p(-np.minimum(drops / remaining, 1.0 - 1e-12)), dtype=float)

    def null_maxima(self, reduced: Array, rng: np.random.Generator, draws: int) -> Array:
        """Return the largest ratio over all candidates in `draws` simulated noise-only data sets, shape (draws,)."""
        used = np.unique(np.concatenate(self.groups)) if self.groups else np.zeros(0, dtype=int)
        scale = np.sqrt(np.maximum(np.diag(reduced)[used], np.finfo(float).tiny))
        correlation = reduced[np.ix_(used, used)] / np.outer(scale, scale)
        values, vectors = np.linalg.eigh(correlation)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        z = root @ rng.standard_normal((used.size, draws))
        position = {int(c): i for i, c in enumerate(used)}
        top = np.zeros(draws)
        for columns in self.groups:
            rows = [position[int(c)] for c in columns]
            inner = correlation[np.ix_(rows, rows)] + 1e-9 * np.eye(len(rows))
            part = z[rows]
            top = np.maximum(top, np.einsum("id,id->d", part, np.linalg.solve(inner, part)))
        return top


def _drop(reduced: Array, columns: Array) -> float:
    own = reduced[np.ix_(columns, columns)]
    scale = np.sqrt(np.maximum(np.diag(own), np.finfo(float).tiny))
    basis = own / np.outer(scale, scale) + 1e-9 * np.eye(columns.size)
    r = reduced[columns, 0] / scale
    return float(r @ np.linalg.solve(basis, r))
