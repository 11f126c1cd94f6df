"""A step that the readings show to a millionth is taken from them; another is fitted as ever."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.candidates.signature import Candidate
from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.records.lattice import lattice_of
from analysis.diagnosis.search.recorded_steps import with_recorded_steps
from sim_backend.effects.sensor_quantisation import SensorQuantisation
from tests.analysis.diagnosis.residuals import moved, setting_of

STEP = 1.7e-3


@pytest.mark.parametrize(("off", "is_it"), [(4e-6, True), (0.08, False)])
def test_a_rounding_gets_the_step_of_the_readings_if_it_is_theirs(off: float, is_it: bool) -> None:
    rng = np.random.default_rng(5)
    force = 0.02 * rng.standard_normal(6000)
    reading = STEP * np.rint((moved(force) + 2e-4 * rng.standard_normal(force.size)) / STEP)
    setting, _ = setting_of(force, reading, reading - moved(force), 5e-4)
    setting = replace(setting, states=(np.zeros((1, 2)),))
    start = STEP * (1.0 + off)
    candidate = Candidate(SensorQuantisation, "x", {"step_size": start}, {}, {"step_size": start})
    fit = refit(setting, [candidate], np.ones(1), np.zeros(0), steps=0)
    lattice = lattice_of(reading)
    assert lattice is not None
    told = with_recorded_steps(setting, fit, {"x": lattice})
    (effect,) = told.effects
    assert isinstance(effect, SensorQuantisation)
    if not is_it:
        assert told is fit
        return
    assert effect.step_size == lattice.step == pytest.approx(STEP, rel=1e-9)
    assert (told.names, told.values.tolist(), told.std.tolist()) == (
        ((0, "step_size"),),
        [lattice.step],
        [lattice.std],
    )
    # and it stays, whatever is fitted beside it
    held, sizes = told.held()
    assert refit(setting, held, sizes, told.change).effects == told.effects
    # of an output whose readings show no step, nothing is taken
    assert with_recorded_steps(setting, fit, {}) is fit
