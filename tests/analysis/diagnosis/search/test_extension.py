"""A fit with one more effect begins where that is better than without it, however far off screening was."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.fitting.refit import refit
from analysis.diagnosis.search.extension import extended
from sim_backend.effects.cubic_stiffness import CubicStiffness
from tests.analysis.diagnosis.fitting.test_parts import HIDDEN, axes, hypothesis, measured


@pytest.mark.parametrize("too_far", [1.0, 30.0])
def test_a_screened_start_that_is_too_far_ends_where_a_good_one_does(too_far):
    """Of 30 times the spring a halving four times over leaves 1.9, of nuisances at their bounds 0.2 of a deviation."""
    assert isinstance(HIDDEN[0], CubicStiffness)
    setting = measured(axes(), HIDDEN[:1])
    fit = refit(setting, (), np.zeros(0), np.zeros(len(setting.nuisances)))
    (candidate,), sizes = hypothesis(setting, HIDDEN[:1])
    nuisances = np.full(len(setting.nuisances), 0.0 if too_far == 1.0 else 1.0)
    found = extended(setting, fit, candidate, too_far * sizes, nuisances)
    assert found.misfit < fit.misfit
    assert found.misfit == pytest.approx(found.rows, rel=0.05)
    assert found.values[0] == pytest.approx(HIDDEN[0].stiffness, abs=4.0 * found.std[0])
