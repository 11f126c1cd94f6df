"""How many steps a sample takes: as fine as its modes turn, and as the frictions in it brake."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from analysis.diagnosis.fitting.fit import Fit, Setting, residuals_of, simulated
from analysis.diagnosis.fitting.starts import stack_white
from analysis.diagnosis.nominal.tuning import turned
from sim_backend.effects.dominant import residues
from sim_backend.linear import ModalModel

_FINEST = 32
"""The most steps to a sample."""

_ANGLE = 0.06
"""By which a mode may turn within a step."""

_BRAKED = 0.25
"""Part of its rate by which a friction may brake an axis within a step near rest.

From 1 on an explicit step overshoots, from 2 on it swings up: a fit then makes the friction softer than it is.
"""


def steps_of(linear: ModalModel, rate_hz: float) -> int:
    """Return the steps per sample at which a torque that depends on the motion is simulated well enough.

    The loop's error is of second order: at an angle of 0.06 per step of the mode that moves most, 4e-4 of the torque.
    """
    fastest = 0.0
    for i in range(linear.n_inputs):
        for o in range(linear.n_outputs):
            strength = np.abs(residues(linear, i, o)) / np.maximum(linear.omega_rad_s**2, 1e-12)
            if np.any(strength > 0.0):
                fastest = max(fastest, float(linear.omega_rad_s[int(np.argmax(strength))]))
    return int(np.clip(np.ceil(fastest / rate_hz / _ANGLE), 1, _FINEST))


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


def steps_in_noise(setting: Setting, fit: Fit) -> int:
    """Return the steps per sample at which the error of the simulation is lost in the noise, at least those there are.

    The error of n steps is that of one over n², so what twice the steps change is three quarters of it. In units of the
    noise its sum of squares shall be no more than one: then no parameter is wrong by more than a standard deviation.
    """
    linear = turned(setting.nominal, setting.knobs, fit.change)
    there, finer = (
        residuals_of(setting.data.records, simulated(one, linear, fit.effects))
        for one in (setting, replace(setting, substeps=2 * setting.substeps))
    )
    squares = sum(
        float(np.sum(stack_white(setting.whitener, record, (b - a)[:, :, None]) ** 2))
        for record, a, b in zip(setting.data.records, there, finer, strict=True)
    )
    wanted = setting.substeps * (squares * (4.0 / 3.0) ** 2) ** 0.25
    return int(np.clip(np.ceil(wanted), setting.substeps, max(_FINEST, setting.substeps)))
