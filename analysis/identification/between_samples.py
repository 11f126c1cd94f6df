"""What an input does between its samples, held or smooth, and how late it acts: decided by what will be simulated.

A bench's own converter holds its value; a recorder behind filters sees a smooth input. At low frequencies, they differ
only by half a sample of delay. So a delay is fitted with either, and the model is chosen that fits the response best
in the very form in which it is simulated afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.frequency.frf import FrequencyResponse, response_to_steps
from analysis.identification.line_fit import fit_lines, pooled_variance
from analysis.identification.response_fit import RationalFit
from campaigns.progress import Report, part_of, unheard
from sim_backend.model import Intersample

Array = NDArray[np.float64]

HELD_UNLESS = 10.0
"""What another form must gain in the criterion (twice a log-likelihood, in effect) to replace the held one.

A bench that plays steps is the usual case; e^5 to one says that this is none.
"""

NEAR = 0.02
"""A delay so near to whole samples, in samples, is taken as those."""


@dataclass(frozen=True)
class Between:
    """A fit in the form in which it is simulated, with the response and variance it was fitted to.

    `delay` says whether its delays were fitted; `whole_s` (n_u,) holds those that the response was freed of before.
    """

    fit: RationalFit
    lines: FrequencyResponse
    variance: Array | None
    intersample: Intersample
    delay: bool
    whole_s: Array


def fit_between_samples(
    measured: FrequencyResponse,
    rate_hz: float,
    orders: tuple[int, ...],
    *,
    equal_weights: bool = False,
    report: Report = unheard,
) -> Between:
    """Return the model of a measured response, held or smooth, with or without a delay, whichever meets it best."""
    variance = None if equal_weights else pooled_variance(measured)
    nothing = np.zeros(measured.response.shape[2])
    held = fit_lines(measured, variance, rate_hz, orders, report=part_of(report, 0.0, 0.4))
    plain = Between(held, measured, variance, "held", False, nothing)
    smooth = fit_lines(measured, variance, None, orders, report=part_of(report, 0.4, 0.8))
    if held.criterion <= smooth.criterion:
        return plain
    report(0.8, 1.0, "fitting delays")
    late = smooth.model.delay_s * rate_hz
    if variance is None:
        # the uncertainty of a line is unknown, so no misfit determines a fraction of a sample: whole samples are used
        lines = response_to_steps(measured, rate_hz, np.rint(late))
        fit = fit_lines(lines, None, rate_hz, (smooth.model.n_blocks,))
        return Between(fit, lines, None, "band-limited", False, np.rint(late) / rate_hz)
    # a hold is late by half a sample by itself
    found = _late(measured, smooth, late, rate_hz, "band-limited")
    found += [plain, *_late(measured, smooth, np.maximum(late - 0.5, 0.0), rate_hz, "held")]
    return min(found, key=lambda one: one.fit.criterion - (HELD_UNLESS if one.intersample == "held" else 0.0))


def _late(
    measured: FrequencyResponse,
    smooth: RationalFit,
    late: Array,
    rate_hz: float,
    intersample: Intersample,
) -> list[Between]:
    """Return the fits of one form with delays of about `late` (n_u,) samples: of whole ones on either side, and free.

    On held steps, a delay of a fraction of a sample is exactly a direct path beside a delay of the next larger whole
    number of samples. A free delay needs fewer numbers, and is exact at low frequencies.
    """
    order, start = (smooth.model.n_blocks,), smooth.model.with_(delay_s=np.zeros_like(late))
    wholes = [np.floor(late + NEAR), np.ceil(late - NEAR)]
    fits = []
    for whole in wholes if np.any(wholes[0] != wholes[1]) else wholes[:1]:
        lines = _as_played(measured, whole, rate_hz, intersample)
        variance = pooled_variance(lines)
        each = [fit_lines(lines, variance, rate_hz, order, first) for first in (None, start)]
        fit = min(each, key=lambda one: one.criterion)
        fits.append(Between(fit, lines, variance, intersample, False, whole / rate_hz))
    if len(fits) > 1:
        lines = _as_played(measured, np.zeros_like(late), rate_hz, intersample)
        variance = pooled_variance(lines)
        fit = fit_lines(lines, variance, rate_hz, order, start.with_(delay_s=late / rate_hz), delay=True)
        fits.append(Between(fit, lines, variance, intersample, True, np.zeros_like(late)))
    return fits


def _as_played(
    measured: FrequencyResponse, whole: Array, rate_hz: float, intersample: Intersample
) -> FrequencyResponse:
    """Return the response to the steps that a simulation plays, freed of whole samples of delay (n_u,)."""
    if intersample == "band-limited":
        return response_to_steps(measured, rate_hz, whole)
    return response_freed(measured, whole, rate_hz)


def response_freed(measured: FrequencyResponse, whole: Array, rate_hz: float) -> FrequencyResponse:
    """Return the response of what acts `whole` (n_u,) samples earlier."""
    early = np.exp(2j * np.pi * (measured.frequency_hz / rate_hz)[:, None, None] * whole)
    return replace(measured, response=measured.response * early)
