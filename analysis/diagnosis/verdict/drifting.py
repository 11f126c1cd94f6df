"""A drifting reading: how much of a model's slowest residual is the same in every run, counted from its start?

Slow noise is estimated from the model's residual alone, and so absorbs a drift. Noise rises towards low frequencies no
more steeply than a random walk does: each cosine coefficient times its frequency is then no larger than the next, and
a drift is nearly all of the few lowest. The remaining part of those, beside the drift and a constant of every run's
own, gives the noise.
"""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.fitting.balance import in_noise
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.starts import Start, stack_white
from analysis.diagnosis.noise.whitener import Whitener, frequency_of_rows
from analysis.diagnosis.records.dataset import Record
from analysis.diagnosis.verdict.lack_of_fit import LackOfFit, in_words
from sim_backend.linear import Array

_WHAT = "the seconds of a run"

_BANDS = 2
"""Lowest bands in which a drift, and the noise beside it, are estimated: a dozen coefficients each."""

_LEAST = 3
"""Fewest coefficients that give the noise beside a drift."""

_SAME = 1e-6
"""A drift with a tolerance 1 − R² below this is one that the start of a run explains."""


def drifts(setting: Setting, fit: Fit) -> tuple[LackOfFit, ...]:
    """Return how much of the slowest that `fit` leaves of each reading is a drift from the start of every run.

    A drift is a slope and a curvature. Empty where slow noise is known from repetitions, or nothing repeats.
    """
    whitener, records = setting.whitener.flat(), setting.data.records
    if not (whitener.repeats and whitener.guessed):
        return ()
    starts = in_noise(setting, whitener, fit).starts
    longest = max(record.n for record in records)
    found = []
    for o in range(setting.data.n_outputs):
        parts = [
            _slowest(whitener, record, start, np.column_stack([residual[:, o], _drift(record.n, longest)]), o)
            for record, start, residual in zip(records, starts, fit.residuals, strict=True)
        ]
        one = _part(np.concatenate([rows for rows, _ in parts]), sum(taken for _, taken in parts))
        if one is not None:
            gain, columns, known_from = one
            shares = tuple(float(k == o) for k in range(setting.data.n_outputs))
            found.append(
                LackOfFit(
                    *in_words(_WHAT, True, o, setting.places), gain, gain, columns, known_from=known_from, shares=shares
                )
            )
    return tuple(found)


def _drift(n: int, longest: int) -> Array:
    """Return a constant, a slope and a curvature over `n` samples (n, 3), one at the end of the `longest` record."""
    return np.vander(np.arange(n) / longest, 3, increasing=True)


def _slowest(whitener: Whitener, record: Record, start: Start, columns: Array, o: int) -> tuple[Array, float]:
    """Return the lowest coefficients of `columns` (n, 4) at output `o` times frequency, without the second: (rows, 3).

    The unknown start is projected out as well; and return how many coefficients that and the second column take.
    """
    mask = record.fitted()
    values = np.zeros((record.n, len(whitener.outputs), columns.shape[1]))
    values[:, o] = columns
    white = start.project(stack_white(whitener, record, values))
    # a constant is as low as a quarter of a frequency bin
    frequency = frequency_of_rows(mask, least=0.25)
    band = whitener.band_of_rows(mask)
    slowest = np.flatnonzero((band >= 0) & (band < min(_BANDS, whitener.guessed)))
    at = o * frequency.size + slowest
    rows = white[at] * frequency[slowest, None]
    constant = rows[:, 1] / max(float(np.linalg.norm(rows[:, 1])), np.finfo(float).tiny)
    rest = rows[:, [0, 2, 3]]
    return rest - np.outer(constant, constant @ rest), float(np.sum(start.q[at] ** 2)) + 1.0


def _part(rows: Array, taken: float) -> tuple[float, int, float] | None:
    """Return what a drift explains in units of the noise beside it, its columns, and how many coefficients show that.

    `rows` (n, 3) are those of the residual and of the drift. Nothing where there are too few.
    """
    residual, drift = rows[:, 0], rows[:, 1:]
    size = np.linalg.norm(drift, axis=0)
    if rows.shape[0] == 0 or not np.all(size > 0.0):
        return None
    basis, strength, _ = np.linalg.svd(drift / size, full_matrices=False)
    basis = basis[:, strength > _SAME]
    left = rows.shape[0] - basis.shape[1] - taken
    if left < _LEAST:
        return None
    explained = float(np.sum((basis.T @ residual) ** 2))
    noise = (float(residual @ residual) - explained) / left
    return explained / max(noise, np.finfo(float).tiny), basis.shape[1], left
