"""How many steps a sample takes where a friction acts: a coarser one would overshoot rest, and swing about it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.diagnosis.fitting.fit import Fit, Setting
from sim_backend.effects.dominant import residues

_BRAKED, _FINEST = 0.25, 32
"""Part of its rate by which a friction may brake an axis within a step near rest, and the most steps to a sample.

From 1 on an explicit step overshoots, from 2 on it swings up: a fit then makes the friction softer than it is.
"""


def steps_for(setting: Setting, fits: Sequence[Fit]) -> int:
    """Return the steps per sample that the effects of `fits` ask for, at least those of `setting`."""
    places, most = setting.places, float(setting.substeps)
    for effect in (e for fit in fits for e in fit.effects):
        braking, where = effect.braking(), effect.where
        if braking > 0.0 and where in places.inputs and where in places.outputs:
            j, o = places.inputs.index(where), places.outputs.index(where)
            mobility = abs(float(np.sum(residues(setting.nominal, j, o))))
            most = max(most, braking * mobility / setting.data.rate_hz / _BRAKED)
    return min(int(np.ceil(most)), max(_FINEST, setting.substeps))
