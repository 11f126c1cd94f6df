"""By how many standard deviations an experiment would separate two hypotheses, once everything else may adapt.

If one hypothesis is true, fitting the other to the old and the new data together leaves a sum of squares that is
larger by d², and d is what is called the separation. To second order about the fits to the old data

    d² = min over x of |W (δ - J x)|² + xᵀ M x,

with δ the difference of the two predictions for the new experiment, J the sensitivities of the second one to all its
parameters (nominal numbers and effects), W the whitening of the noise with the unknown start projected out, and M the
information that the old data and the prior hold about these parameters. Since J is taken at one point, a full refit
of a very different hypothesis may leave less than d² says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.diagnosis.candidates.parameters import parameters_of
from analysis.diagnosis.experiment.hypotheses import Hypothesis
from analysis.diagnosis.fitting.fit import Setting, residuals_of, simulated
from analysis.diagnosis.fitting.refit import exact_sensitivities
from analysis.diagnosis.fitting.starts import Start, stack_white, start_of
from analysis.diagnosis.nominal.tuning import root_of, turned, turning
from analysis.diagnosis.records.dataset import Dataset, Record
from sim_backend.linear import Array

_ROUNDING = 1e-12
"""Directions of the parameters with less information than this part of the largest are left where they are."""


def information(setting: Setting, hypothesis: Hypothesis) -> Array:
    """Return M (k, k): what data and prior of `setting` hold about the nuisances, then the effects' parameters."""
    total = _prior(setting, hypothesis)
    _, columns = _responses(setting, hypothesis)
    for record, start, part in zip(setting.data.records, setting.starts, columns, strict=True):
        white = start.project(stack_white(setting.whitener, record, part))
        total += white.T @ white
    return total


def _responses(setting: Setting, hypothesis: Hypothesis) -> tuple[list[Array], list[Array]]:
    """Return, per record of `setting`, what a hypothesis expects (n, n_y), and its sensitivities (n, n_y, k).

    Those of the nuisances are found with the torques on the structure held, those of the effects in full simulation.
    """
    fit = hypothesis.fit
    linear = turned(setting.nominal, setting.nuisances, fit.change)
    motions = simulated(setting, linear, fit.effects)
    records = setting.data.records
    residuals = residuals_of(records, motions)
    own: Sequence[Array] = [np.zeros((*r.y.shape, 0)) for r in records]
    if fit.effects:
        held = replace(fit, change=np.zeros(0), residuals=residuals)
        own = exact_sensitivities(replace(setting, nominal=linear, nuisances=[]), held)
    turn = turning(linear, setting.nuisances, setting.data.rate_hz, through_delay=False)
    columns = [
        np.concatenate([turn.columns(motion.torque, states), part], axis=2)
        for motion, states, part in zip(motions, setting.states, own, strict=True)
    ]
    return [m.reading for m in motions], columns


def with_spread(setting: Setting, hypothesis: Hypothesis, known: Array) -> Hypothesis:
    """Return the hypothesis with the standard deviations that follow from `known` (k, k), see `information`."""
    scales, _ = parameters_of(*hypothesis.fit.held())
    size = np.sqrt(np.maximum(np.diag(known), np.finfo(float).tiny))
    inverse = np.linalg.pinv(known / np.outer(size, size), rcond=_ROUNDING, hermitian=True)
    spread = (np.sqrt(np.maximum(np.diag(inverse), 0.0)) / size)[len(setting.nuisances) :]
    fit = hypothesis.fit
    std = [d * (abs(v) if s.log else abs(s.unit)) for d, v, s in zip(spread, fit.values, scales, strict=True)]
    return replace(hypothesis, fit=replace(fit, std=np.array(std)))


def _prior(setting: Setting, hypothesis: Hypothesis) -> Array:
    size = len(setting.nuisances) + hypothesis.fit.values.size
    total = np.zeros((size, size))
    n_nuisances, root = len(setting.nuisances), root_of(setting.nuisances)
    total[:n_nuisances, :n_nuisances] = root.T @ root
    return total


@dataclass(frozen=True)
class Prediction:
    """What a hypothesis predicts of a planned record: outputs `reading` (n, n_y), and `columns` (n, n_y, k).

    The columns are its derivatives by the k free parameters.
    """

    reading: Array
    columns: Array
    start: Start


def prediction(setting: Setting, hypothesis: Hypothesis, record: Record) -> Prediction:
    """Return what `hypothesis` expects of `record`, whose inputs are played from rest."""
    linear = turned(setting.nominal, setting.nuisances, hypothesis.fit.change)
    data = Dataset(setting.data.rate_hz, (record,))
    start = start_of(record, linear, setting.whitener, data.rate_hz)
    planned = replace(setting, data=data, starts=(start,), states=(np.zeros((setting.nominal.n_blocks, 2)),))
    (reading,), (columns,) = _responses(planned, hypothesis)
    return Prediction(reading, columns, start)


def separation(setting: Setting, record: Record, expected: Prediction, known: Array) -> float:
    """Return d in sigma: `record`, as another hypothesis would give it, explained by what one hypothesis `expected`.

    `known` (k, k) is what the old data hold about the parameters of the latter: see `information`. Infinite where no
    finite number is expected.
    """
    difference = record.y - expected.reading
    if not np.isfinite(difference).all():
        return float("inf")
    # a parameter that cannot be moved in either direction cannot adapt
    columns = np.where(np.isfinite(expected.columns).all(axis=(0, 1)), expected.columns, 0.0)
    columns = np.concatenate([difference[:, :, None], columns], axis=2)
    white = expected.start.project(stack_white(setting.whitener, record, columns))
    return left_over(white[:, 0], white[:, 1:], known)


def left_over(difference: Array, columns: Array, known: Array) -> float:
    """Return the root of min over x (k,) of |difference - columns x|² + xᵀ known x; `columns` are (n, k)."""
    normal, slope = columns.T @ columns + known, columns.T @ difference
    scale = np.sqrt(np.maximum(np.diag(normal), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    live = values > _ROUNDING * values[-1]
    x = vectors[:, live] @ ((vectors[:, live].T @ (slope / scale)) / values[live]) / scale
    rest = difference - columns @ x
    return float(np.sqrt(rest @ rest + x @ known @ x))
