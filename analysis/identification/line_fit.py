"""A model fitted to the lines of a response, each weighed by its scatter."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.frequency.frf import FrequencyResponse, smoothed
from analysis.identification.modal_parameters import Structure
from analysis.identification.rational import fit_rational
from analysis.identification.response_fit import RationalFit
from campaigns.progress import Report, part_of, unheard
from sim_backend.errors import DataError
from sim_backend.linear import ModalModel

Array = NDArray[np.float64]

SEARCH_LINES = 1000
"""Lines on which a start is searched: modes are far wider than a thousandth of the band."""

POOLED_LINES = 20
"""Lines to either side over which a variance is pooled."""

ITERATIONS = 60


def fit_lines(
    measured: FrequencyResponse,
    variance: Array | None,
    hold: float | None,
    orders: tuple[int, ...],
    start: ModalModel | None = None,
    report: Report = unheard,
    *,
    delay: bool | None = None,
) -> RationalFit:
    """Fit all lines from `start`, or from starts searched on about a thousand of them, twice: one may be poor.

    `variance` is of the shape of the response, (n_f, n_y, n_u). `delay` lets every input be late; by default where
    nothing is held (`hold` is None).
    """
    f = measured.frequency_hz
    usable = tuple(n for n in orders if 4 * n < f.size) or orders[:1]
    structure = Structure(delay=hold is None if delay is None else delay)

    def fitted(every: int, choice: tuple[int, ...], start: ModalModel | None, told: Report = unheard) -> RationalFit:
        return fit_rational(
            f[::every],
            measured.response[::every],
            choice,
            variance=None if variance is None else variance[::every],
            hold_rate_hz=hold,
            structure=structure,
            start=start,
            iterations=ITERATIONS,
            report=told,
        )

    if start is not None:
        return fitted(1, usable, start, report)
    every = f.size // SEARCH_LINES + 1
    steps = [1] if every == 1 else [every, every + 1]
    shares = np.linspace(0.0, 1.0, len(steps) + 1)
    found = [fitted(step, usable, None, part_of(report, *shares[i : i + 2])) for i, step in enumerate(steps)]
    if every > 1:
        found = [fitted(1, (one.model.n_blocks,), one.model) for one in found]
    return min(found, key=lambda one: one.criterion)


def pooled_variance(measured: FrequencyResponse) -> Array | None:
    """Return the variance (n_f, n_y, n_u) to weight by; None for one period without a spare realisation.

    Pooled over neighbouring lines, because one line's own has too few degrees of freedom to divide by.
    """
    try:
        return smoothed(measured.variance, POOLED_LINES)
    except DataError:
        return None
