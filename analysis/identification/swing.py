"""The swing from the start of a periodic record, taken out of it: what dies away is not noise.

Periods of a steady state differ by noise. A light mode that was set swinging by the start makes them differ as well,
for 1 / (decay rate · period) periods, and that difference would count as noise. It is a free swing of the modes, whose
frequencies and decay rates a first fit knows well enough; its size follows from the differences between periods, in
which the steady state cancels.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.frequency.frf import FrequencyResponse, frequency_response_periodic
from analysis.identification.between_samples import Between, fit_between_samples
from analysis.identification.realisations import Realisations, noise_power
from analysis.linear.simulate import simulate_linear
from campaigns.progress import Report, part_of
from sim_backend.linear import ModalModel, discretise

ROUNDS, FALLS = 3, 0.95
"""How often the swing from a start is taken out with the modes of a better fit, and to which part of its power noise
must fall for it."""

WORTH = 0.5
"""Part of the differences between periods, as power, that must go before the swing counts: noise has swings in it, too,
a few numbers of very many."""


def settled_response(
    data: Realisations, orders: tuple[int, ...], equal_weights: bool, report: Report
) -> tuple[Realisations, FrequencyResponse, Between]:
    """Return the data without the swing from their start, their response, and what was fitted to it.

    A response that holds a swing gives a frequency and a decay rate by which a part of it is left: so again, while
    noise falls. Data that begin in steady state come back as they are.
    """
    used = data
    for k in range(ROUNDS + 1):
        measured, part = _measured(used), part_of(report, 0.8 * (1.0 - 0.5**k), 0.8 * (1.0 - 0.5 ** (k + 1)))
        chosen = fit_between_samples(measured, data.rate_hz, orders, equal_weights=equal_weights, report=part)
        settled = without_swing(data, chosen.fit.model) if k < ROUNDS else None
        if settled is None or noise_power(settled).sum() > FALLS * noise_power(used).sum():
            break
        used = settled
    return used, measured, chosen


def without_swing(data: Realisations, model: ModalModel) -> Realisations | None:
    """Return the data without the free swing of the modes, None where that explains little of how periods differ."""
    n, n_y, realisations, periods = data.outputs.shape
    if data.group != 1 or periods < 2:
        return None
    free = _free_swings(model, n * periods, data.rate_hz)
    change = (free[n:] - free[:-n]).reshape(-1, free.shape[2])
    scale = np.linalg.norm(change, axis=0)
    usable = scale > 1e-9 * scale.max(initial=0.0)
    if not usable.any():
        return None
    outputs = data.outputs.copy()
    before = after = 0.0
    for r in range(realisations):
        y = data.outputs[:, :, r].transpose(2, 0, 1).reshape(-1, n_y)
        apart = (y[n:] - y[:-n]).ravel()
        size = np.linalg.lstsq(change[:, usable] / scale[usable], apart, rcond=1e-9)[0] / scale[usable]
        left = apart - change[:, usable] @ size
        before, after = before + float(apart @ apart), after + float(left @ left)
        rest = y - free[:, :, usable] @ size
        outputs[:, :, r] = rest.reshape(periods, n, n_y).transpose(1, 2, 0)
    return replace(data, outputs=outputs) if after < (1.0 - WORTH) * before else None


def _free_swings(model: ModalModel, rows: int, rate_hz: float) -> np.ndarray:
    """Return the outputs (samples, n_y, 2 m) from each unit state of the modes, at rest otherwise."""
    discrete = discretise(model, rate_hz)
    nothing = np.zeros((rows, model.n_inputs))
    units = np.eye(2 * model.n_blocks).reshape(-1, model.n_blocks, 2)
    return np.stack([simulate_linear(discrete, nothing, unit) for unit in units], axis=2)


def _measured(data: Realisations) -> FrequencyResponse:
    measured = frequency_response_periodic(data.inputs, data.outputs, data.rate_hz)
    return replace(measured, output_noise=measured.output_noise * data.group)  # that of one period
