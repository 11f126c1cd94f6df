"""To what part of itself a fit knows the size of what it adds."""

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.fit import Fit
from sim_backend.effects.coulomb_friction import CoulombFriction
from sim_backend.effects.sensor_gain import SensorGain


def fit(candidates, names, values, std):
    none = np.zeros(0)
    return Fit(candidates, none, (), 0.0, 0.0, 1, 0.0, 0.0, names, np.array(values), np.array(std), (), ())


def test_the_effect_that_is_known_least_counts_by_its_best_known_size():
    friction = Candidate(CoulombFriction, "x", {"give": 1e-6}, {"torque": 1.0, "offset": 1.0}, {})
    gain = Candidate(SensorGain, "x", {}, {"relative": 1.0}, {})
    names = ((0, "torque"), (0, "offset"), (0, "give"), (1, "relative"))
    found = fit((friction, gain), names, [2.0, 0.0, 1e-6, -0.1], [0.1, 3.0, 1e-6, 0.002])
    assert found.least_known == pytest.approx(
        0.05
    )  # the torque; a shape is no size, and nothing is known of the offset


def test_without_effects_there_is_no_size():
    assert fit((), (), [], []).least_known == 0.0
