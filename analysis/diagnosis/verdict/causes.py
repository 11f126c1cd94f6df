"""The causes that a judgement names, with their parameters in the units of the model's ports."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.result import Cause, Estimate
from analysis.diagnosis.verdict.judging import Fitted, Judgement
from sim_backend.model import Model
from sim_backend.modes import units_at


def causes_of(best: Fitted, judgement: Judgement, model: Model) -> tuple[Cause, ...]:
    """Return the named causes with their parameters in units of the model's ports."""
    spread = float(np.sqrt(judgement.inflation))
    return tuple(_cause_of(i, best, model, judgement.posterior, spread) for i in judgement.named)


def _cause_of(i: int, best: Fitted, model: Model, posterior: float, spread: float) -> Cause:
    """Return effect `i` of a fit as a cause, its standard deviations `spread` times those of the fit."""
    effect = best.effects[i]
    u, y = units_at(model, effect.where)
    units = {p.name: p.dimension.unit(u, y) for p in effect.parameters()}
    estimates = {
        name: Estimate(float(value), float(std * spread), units[name])
        for (owner, name), value, std in zip(best.names, best.values, best.std, strict=True)
        if owner == i
    }
    return Cause(effect.reported(), effect.where, posterior, estimates, f"the residual {effect.symptom}")
