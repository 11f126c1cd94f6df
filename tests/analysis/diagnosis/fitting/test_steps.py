"""Steps are as fine as a friction is sharp: a coarse one would swing about rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.fitting.fit import steps_for
from sim_backend.effects import make_effect
from tests.analysis.diagnosis.residuals import RATE_HZ, RESONANCE_HZ, moved, setting_of


@pytest.mark.parametrize(("breakaway_rate", "steps"), [(1e3, 4), (None, 20), (1e-9, 32)])
def test_steps_follow_the_slope_of_the_friction_at_rest(breakaway_rate: float | None, steps: int) -> None:
    """A rate that a sample brakes five times over takes twenty steps; a sharper one as many as may be."""
    force = np.random.default_rng(2).standard_normal(2000)
    setting, fit = setting_of(force, moved(force), np.zeros(2000), 1e-3)
    mobility = (2.0 * np.pi * RESONANCE_HZ) ** 2
    slope = breakaway_rate or 0.1 * mobility / (5.0 * RATE_HZ)
    rubs = make_effect("coulomb-friction", "x", {"torque": 0.1, "breakaway_rate": slope})
    assert steps_for(replace(setting, substeps=4), [replace(fit, effects=(rubs,))]) == steps
    assert steps_for(replace(setting, substeps=4), [fit]) == 4
