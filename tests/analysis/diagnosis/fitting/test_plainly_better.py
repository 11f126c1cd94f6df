"""Of two sets of numbers that were fitted to the same rows, the one that simulates them stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.fitting.balance import plainly_better
from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.nominal.tuning import nuisances_of, turned
from sim_backend.linear import DiscreteModel, discretise
from tests.analysis.diagnosis.residuals import MODEL, RATE_HZ, setting_of

Array = np.ndarray
NOISE = 1e-3
CUT = 300  # samples of motion before the record begins


@pytest.fixture
def tuned(request: pytest.FixtureRequest) -> tuple[Setting, Fit, Array]:
    """Return a setting, a fit that turns each nuisance by a hundredth, and the readings' noise; `param` is what is
    true."""
    rng = np.random.default_rng(4)
    force = np.repeat(rng.normal(size=60), 25)
    nominal = MODEL.linear()
    nuisances = nuisances_of(nominal, 0.03)
    change = np.full(len(nuisances), 0.01)
    truth = discretise(turned(nominal, nuisances, change) if request.param == "tuned" else nominal, RATE_HZ)
    noise = NOISE * rng.normal(size=force.size - CUT)
    reading = played(truth, force[:, None])[CUT:] + noise
    setting, fit = setting_of(force[CUT:], reading, reading, NOISE)
    still = (np.zeros((1, 2)),)
    return (
        replace(setting, nuisances=nuisances, states=still),
        replace(fit, change=change, change_std=change, states=still),
        noise,
    )


def played(model: DiscreteModel, force: Array) -> Array:
    """Return the response (n,) of a model to a force (n, 1) from rest."""
    return np.asarray(simulate(model, force)[:, 0])


@pytest.mark.parametrize("tuned", ["given"], indirect=True)
def test_tuned_numbers_that_simulate_worse_give_way_to_the_given_ones(tuned: tuple[Setting, Fit, Array]) -> None:
    """The record begins in motion: what is left is the noise, less what four free numbers of a start can take."""
    setting, fit, noise = tuned
    stays = plainly_better(setting, fit)
    assert np.all(stays.change == 0.0)
    assert np.all(stays.change_std == 0.0)
    from_rest = setting.data.records[0].y[:, 0] - played(
        discretise(setting.nominal, RATE_HZ), setting.data.records[0].u
    )
    assert np.sum(from_rest**2) > 100.0 * np.sum(noise**2)
    # two states take one row's worth of noise each; ten times over
    assert np.sum((stays.residuals[0][:, 0] - noise) ** 2) < 10.0 * 2.0 * NOISE**2


@pytest.mark.parametrize("tuned", ["tuned"], indirect=True)
def test_tuned_numbers_that_simulate_better_stay(tuned: tuple[Setting, Fit, Array]) -> None:
    """The given ones were fitted elsewhere, or badly."""
    setting, fit, _ = tuned
    assert plainly_better(setting, fit) is fit
