"""The unknown state in which each record starts: projected out of everything, and estimated for the simulation.

What a start can add to the outputs is linear in it, so it is eliminated exactly from every regression; only where an
effect is large does the start have to be known in the simulation itself, and there it follows from the same projection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.diagnosis.noise.whitener import Whitener
from analysis.diagnosis.nominal.responses import answers_to_before, coasting, free_responses, played
from analysis.diagnosis.records.dataset import Dataset, Record
from sim_backend.linear import Array, ModalModel

_NEGLIGIBLE = 1e-9
"""A direction this much weaker than the strongest cannot be told from rounding and is left alone."""

_FORGOTTEN = 1e-6
"""A start of which less is left when the fitted rows begin is not found from them: it would have to be enormous."""


@dataclass(frozen=True)
class Start:
    """What a record's start can add: an orthonormal basis `q` (rows, k), whitened.

    `back` (2 m, k) gives the states, `before` (b, k) the commands that are still on their way.
    """

    q: Array
    back: Array
    before: Array

    def project(self, white: Array) -> Array:
        """Return `white` (rows, …) without what a start can explain, its columns as they lie in memory."""
        return np.asarray(white - ((self.q.T @ white).T @ self.q.T).T)

    def states(self, white: Array) -> Array:
        """Return the modal states (m, 2) that explain `white` (rows,) best."""
        return np.asarray((self.back @ (self.q.T @ white)).reshape(-1, 2), dtype=float)


def stack_white(whitener: Whitener, record: Record, values: Array) -> Array:
    """Return the fitted rows of `values` (n, n_y, k), whitened, outputs one below the other: (n_y · rows, k)."""
    mask = record.fitted()
    return record.weight * np.concatenate([whitener.rows(values[:, o], mask, o) for o in range(values.shape[1])])


def start_of(record: Record, linear: ModalModel, whitener: Whitener, rate_hz: float) -> Start:
    """Return the start basis of one record: of the modes of `linear`, and of commands that are still on their way."""
    model = played(linear, rate_hz)
    free, late = free_responses(model, record.n), answers_to_before(model, record.n)
    white = stack_white(whitener, record, free)
    seen, whole = (np.linalg.norm(part, axis=(0, 1)) for part in (free[record.fitted()], free))
    white[:, seen < _FORGOTTEN * whole] = 0.0
    states, back = _basis(white, np.linalg.norm(white, axis=0))
    # the first rows alone tell what is on its way from what swings already: the states are what explains most by itself
    white = stack_white(whitener, record, late)
    commands, before = _basis(white - states @ (states.T @ white), np.linalg.norm(white, axis=0))
    back, before = np.pad(back, ((0, 0), (0, commands.shape[1]))), np.pad(before, ((0, 0), (states.shape[1], 0)))
    return Start(np.concatenate([states, commands], axis=1), back, before)


def _basis(columns: Array, scale: Array) -> tuple[Array, Array]:
    """Return an orthonormal basis (rows, k) of columns (rows, c) of some `scale`, and what gives them back (c, k)."""
    scale = np.where(scale > 0.0, scale, 1.0)
    left, size, right = np.linalg.svd(columns / scale, full_matrices=False)
    keep = size > _NEGLIGIBLE * np.max(size, initial=1e-300)
    return left[:, keep], (right[keep].T / size[keep]) / scale[:, None]


def without_starts(
    data: Dataset, linear: ModalModel, whitener: Whitener, residuals: Sequence[Array]
) -> tuple[Array, ...]:
    """Return `residuals`, (n, n_y) per record, less what a start of every mode of `linear` explains of them."""
    model = played(linear, data.rate_hz)

    def rest(record: Record, start: Start, residual: Array) -> Array:
        white = stack_white(whitener, record, residual[:, :, None])[:, 0]
        left = residual - answers_to_before(model, record.n) @ (start.before @ (start.q.T @ white))
        states = start.states(stack_white(whitener, record, left[:, :, None])[:, 0])
        return left - coasting(model, states, record.n)

    starts = starts_of(data, linear, whitener)
    return tuple(rest(*each) for each in zip(data.records, starts, residuals, strict=True))


def starts_of(data: Dataset, linear: ModalModel, whitener: Whitener) -> tuple[Start, ...]:
    """Return the start basis of every record."""
    return tuple(start_of(r, linear, whitener, data.rate_hz) for r in data.records)
