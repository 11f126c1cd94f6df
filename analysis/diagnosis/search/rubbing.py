"""An axis that drifts and rubs: how large the friction is, from the balance of torques.

What nothing holds adds up every error of its torque. Beside the friction that the model lacks its residual is then
drift, and along the measured motion no friction explains that: at rest it is whatever holds the axis, which the motion
does not show. A balance of torques over the rows in which the axis moves knows its size all the same, and a simulation
that has it from the start stays near the record.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.search.extension import extended
from analysis.diagnosis.search.shortlist import Screen
from analysis.identification.axes import Moved, moved_by
from sim_backend.effects.coulomb_friction import CoulombFriction


def rubbing(setting: Setting, fit: Fit, found: Screen) -> list[Fit]:
    """Return `fit` with a friction of the size that the balance of torques tells, one fit for each of its forms.

    None where the balance tells of none, at an axis that has its friction, and where the readings are not those of one
    drive each. The knobs begin at the nominal model: what stands in for a friction has moved them.
    """
    rubs = {c.where for c in fit.candidates if c.effect.reported() == CoulombFriction.name}
    if rubs >= set(setting.places.inputs):
        return []
    moved = setting.once.of("moved", partial(_moved, setting))
    if moved is None:
        return []
    of = dict(zip(setting.places.inputs, moved, strict=True))
    fits = []
    for i in found.best_per_key():
        candidate = found.candidates[i]
        if candidate.effect.reported() != CoulombFriction.name or candidate.where in rubs:
            continue
        balance = of[candidate.where].balance
        if balance is not None and balance.friction > 0.0:
            sizes = np.array([balance.friction / unit for unit in candidate.unit_sizes.values()])
            fits.append(extended(setting, fit, candidate, sizes, -fit.change))
    return fits


def _moved(setting: Setting) -> list[Moved] | None:
    rows = [(r.u[r.fitted()], r.y[r.fitted()]) for r in setting.data.records]
    return moved_by([u for u, _ in rows], [y for _, y in rows], setting.data.rate_hz)
