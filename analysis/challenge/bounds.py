"""What the best possible estimate could reach: Cramér–Rao bounds, and the held-out error of the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.challenge.campaign import Campaign
from analysis.challenge.families import Hidden
from analysis.challenge.families.surroundings import DroppedSamples
from analysis.challenge.metric import Metric
from analysis.challenge.power import random_energy

Array = NDArray[np.float64]

_STEP = 1e-4
"""Relative step of the differences by which readings are differentiated."""


def bound_deviations(metric: Metric, hidden: Sequence[Hidden]) -> list[dict[str, float]]:
    """Return, per effect, the Cramér–Rao bound of its parameters as standard deviations, by the library's names.

    The nuisances are those of the limits, with their prior, linearised about the bench with its effects. Parameters
    without a bound (that of a rounding, say) are left out.
    """
    slopes = [_slopes(metric, hidden, i) for i in range(len(hidden))]
    found = [s for s in slopes if s.size]
    if not found:
        return [_bound_of_chance(metric, effect) for effect in hidden]
    information = metric.seen(np.column_stack(found)).products()
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))  # a jump has no slope
    covariance = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-10) / np.outer(scale, scale)
    out, at = [], 0
    for effect, slope in zip(hidden, slopes, strict=True):
        if not slope.size:
            out.append(_bound_of_chance(metric, effect))
            continue
        own = slice(at, at + slope.shape[1])
        at += slope.shape[1]
        out.append(_by_name(effect, covariance[own, own]))
    return out


def _slopes(metric: Metric, hidden: Sequence[Hidden], i: int) -> Array:
    """Return the derivative of all whitened readings by each free field of effect `i`, (rows, fields) or empty."""
    effect = hidden[i]
    if effect.random or not effect.smooth or not effect.truth():
        return np.zeros((0, 0))

    def there(field: str, step: float) -> Array:
        moved = replace(effect, **{field: getattr(effect, field) + step})
        return metric.signature([*hidden[:i], moved, *hidden[i + 1 :]])

    steps = {field: _STEP * max(abs(getattr(effect, field)), 1e-300) for field in effect.free()}
    return np.column_stack([(there(f, h) - there(f, -h)) / (2.0 * h) for f, h in steps.items()])


def _by_name(effect: Hidden, covariance: Array) -> dict[str, float]:
    """Return standard deviations by the library's names from the covariance of the free fields."""
    names = list(effect.truth())
    slope = np.empty((len(names), covariance.shape[0]))
    for k, field in enumerate(effect.free()):
        h = _STEP * max(abs(getattr(effect, field)), 1e-300)
        there = [replace(effect, **{field: getattr(effect, field) + s * h}).truth() for s in (1.0, -1.0)]
        slope[:, k] = [(there[0][n] - there[1][n]) / (2.0 * h) for n in names]
    variance = np.einsum("nk,kl,nl->n", slope, covariance, slope)
    return {n: float(np.sqrt(v)) for n, v in zip(names, variance, strict=True) if v > 0.0}


def _bound_of_chance(metric: Metric, effect: Hidden) -> dict[str, float]:
    """Return the bound of an effect of chance: of a share by counting, of a power from its deflection.

    A power raised by r ∝ size² has the information ½ Σ (dr/dsize)² = 4 d²/size².
    """
    if isinstance(effect, DroppedSamples):
        rows = sum(int(run.rows(held_out=False).sum()) for run in metric.campaign.runs)
        return {"fraction": float(np.sqrt(effect.size * (1.0 - effect.size) / rows))}
    if effect.random:
        name = next(iter(effect.truth()))
        return {name: float(effect.size / (2.0 * np.sqrt(random_energy(effect, metric.campaign))))}
    return {}


def held_out_floor(campaign: Campaign, hidden: Sequence[Hidden], readings: list[Array]) -> float:
    """Return the error that the truth leaves in the held-out readings: rms ÷ rms about the mean, over all axes.

    `readings` (n, axes) are those of every run. It is that of the true structure with the true parameters, so what is
    fitted to the same data can only be worse: noise, small unmodelled modes, chance and rounding.
    """
    known = [effect for effect in hidden if effect.predictable]
    predicted = campaign.readings(known, [np.zeros_like(y) for y in readings])
    rows = [run.rows(held_out=True) for run in campaign.runs]
    truth = np.concatenate([y[kept] for y, kept in zip(readings, rows, strict=True)])
    errors = truth - np.concatenate([y[kept] for y, kept in zip(predicted, rows, strict=True)])
    return float(np.sqrt(np.mean((errors / np.std(truth, axis=0)) ** 2)))
