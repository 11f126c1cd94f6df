"""The response with an effect in it is that of the closed form in textbooks."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.linear.predicted import Predictor, changes_the_response
from sim_backend.assembly import places_of
from sim_backend.effects import EFFECTS, make_effect
from sim_backend.effects.base import Site
from tests.analysis.diagnosis.response.tables import F, nominal, response

S = 2j * np.pi * F


def creep(stiffness: float, time_s: float) -> np.ndarray:
    # force + stiffness / (1 + s T) of the position, around the plant
    return response() / (1.0 - response() * stiffness / (1.0 + S * time_s))


CASES = {
    "lag": (("amplifier-lag", {"time_constant_s": 1e-3}), lambda: response() / (1.0 + S * 1e-3)),
    "slow lag": (("amplifier-lag", {"time_constant_s": 0.1}), lambda: response() / (1.0 + S * 0.1)),
    "creep": (("viscoelastic-creep", {"stiffness": 200.0, "time_constant_s": 0.02}), lambda: creep(200.0, 0.02)),
    "delay": (("delay", {"seconds": 3e-4}), lambda: response() * np.exp(-S * 3e-4)),
    "drive": (("actuator-gain", {"relative": 0.2}), lambda: 1.2 * response()),
    "sensor": (("sensor-gain", {"relative": -0.2}), lambda: 0.8 * response()),
}


@pytest.mark.parametrize("case", CASES)
def test_a_response_with_an_effect_is_exact(case):
    (name, values), expected = CASES[case]
    model = nominal(0.0)
    found = Predictor(places_of(model), F).response(model.linear(), [make_effect(name, "x", values)])[:, 0, 0]
    # half a step of the continuous limit: 3e-4 rad at the highest line
    np.testing.assert_allclose(found, expected(), rtol=5e-4)


def test_every_effect_of_the_linear_model_is_tried():
    tried = {e.name for e in EFFECTS if changes_the_response(e)}
    assert {e.name for e in EFFECTS if e.site is Site.MODEL} <= tried
    assert all(e.linear_form for e in EFFECTS if e.name in tried)
