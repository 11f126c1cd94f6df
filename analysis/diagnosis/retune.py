"""Re-tuning the nominal model alone: a damped Gauss-Newton search in the space of inner products.

The most frequent fit of a diagnosis, and linear in everything but frequencies, so it has a faster way than a full
refit: one pass over the data per step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.diagnosis.descent import Descent
from analysis.diagnosis.refit import KNOB_STEP, Fit, Setting, simulated
from analysis.diagnosis.responses import motion
from analysis.diagnosis.starts import stack_white
from analysis.diagnosis.tuning import REACH, sensitivities, turned

Array = NDArray[np.float64]

_STEPS = 15


@dataclass(frozen=True)
class _Point:
    residuals: tuple[Array, ...]
    misfit: float
    penalty: float

    @property
    def objective(self) -> float:
        return self.misfit + self.penalty


def retune(setting: Setting, change: Array) -> Fit:
    """Return the best fit without any new effect, starting from `change` of the knobs."""
    sd = np.array([k.sd for k in setting.knobs])

    def evaluate(x: Array) -> _Point:
        residuals = _residuals(setting, x)
        return _Point(residuals, _misfit(setting, residuals), float(np.sum((x / sd) ** 2)))

    def normal(x: Array, at: _Point) -> tuple[Array, Array]:
        h, slope = _normal(setting, x, at.residuals)
        return h + np.diag(1.0 / sd**2), slope - x / sd**2

    descent = Descent(evaluate, normal, -REACH * sd, REACH * sd, np.full(change.size, KNOB_STEP))
    x, found = descent.run(change, _STEPS)
    none = np.zeros(0)
    return Fit((), x, (), found.misfit, found.penalty, setting.rows, (), none, none, found.residuals)


def _residuals(setting: Setting, change: Array) -> tuple[Array, ...]:
    linear = turned(setting.nominal, setting.knobs, change)
    records = setting.data.records
    if setting.known:
        return tuple(r.y - m.reading for r, m in zip(records, simulated(setting, linear, ()), strict=True))
    return tuple(
        r.y - motion(linear, r.u, setting.data.rate_hz, states)[0]
        for r, states in zip(records, setting.states, strict=True)
    )


def _misfit(setting: Setting, residuals: tuple[Array, ...]) -> float:
    total = 0.0
    for record, residual, start in zip(setting.data.records, residuals, setting.starts, strict=True):
        white = start.project(stack_white(setting.whitener, record, residual[:, :, None])[:, 0])
        total += float(white @ white)
    return total if np.isfinite(total) else np.inf


def _normal(setting: Setting, change: Array, residuals: tuple[Array, ...]) -> tuple[Array, Array]:
    linear = turned(setting.nominal, setting.knobs, change)
    n = len(setting.knobs)
    normal, slope = np.zeros((n, n)), np.zeros(n)
    for record, residual, start in zip(setting.data.records, residuals, setting.starts, strict=True):
        columns = sensitivities(linear, setting.knobs, record.u, setting.data.rate_hz)
        white = start.project(
            stack_white(setting.whitener, record, np.concatenate([columns, residual[:, :, None]], axis=2))
        )
        normal += white[:, :n].T @ white[:, :n]
        slope += white[:, :n].T @ white[:, n]
    return normal, slope
