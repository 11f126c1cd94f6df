"""A drift that every run begins anew is no slow noise: found where there is one, and not in noise that wanders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.diagnosis.fitting.fit import Fit, Setting
from analysis.diagnosis.fitting.starts import starts_of
from analysis.diagnosis.noise.estimate import whitener_from
from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.nominal.tuning import nuisances_of
from analysis.diagnosis.records.dataset import Dataset, Record, Window
from analysis.diagnosis.verdict.drifting import drifts
from analysis.diagnosis.verdict.lack_of_fit import ONE_IN_A_MILLION
from sim_backend.assembly import places_of, transducers_of
from sim_backend.linear import discretise
from tests.analysis.diagnosis.two_axes import AXES, RATE_HZ, two_axes

Array = NDArray[np.float64]
PERIOD, PERIODS, RUNS = 500, 6, 3
ROWS = PERIOD * PERIODS


def _noise(seed: int, wander: float = 0.0) -> list[Array]:
    """Return white noise of unit size (ROWS, 2) in every run, beside a walk of so large steps that goes its own way."""
    rng = np.random.default_rng(seed)
    white = rng.standard_normal((RUNS, ROWS, 2))
    return list(white + wander * np.cumsum(rng.standard_normal((RUNS, ROWS, 2)), axis=1))


def _setting(residuals: list[Array]) -> tuple[Setting, Fit]:
    """Return records of repeated periods with the noise that they tell, and a fit that leaves `residuals` of them."""
    model, rng = two_axes(), np.random.default_rng(1)
    linear = model.linear()
    drive = np.tile(1e4 * rng.standard_normal((PERIOD, 2)), (PERIODS, 1))
    y = simulate(discretise(linear, RATE_HZ), drive)
    records = tuple(
        Record(f"run {k}", drive, y + residual, (Window("all", 0, ROWS, False, PERIOD),))
        for k, residual in enumerate(residuals)
    )
    data = Dataset(RATE_HZ, records)
    whitener = whitener_from(data, residuals)
    starts = starts_of(data, linear, whitener)
    rest = (np.zeros((2, 2)),) * RUNS
    nuisances = nuisances_of(linear, 0.02)
    setting = Setting(data, linear, (), places_of(model), transducers_of(model), nuisances, whitener, starts, rest, 1)
    none = np.zeros(0)
    fit = Fit(
        (), np.zeros(len(nuisances)), (), 0.0, 0.0, 2 * RUNS * ROWS, 0.0, 0.0, (), none, none, tuple(residuals), ()
    )
    return setting, fit


@pytest.mark.parametrize("wander", [0.0, 0.03, 0.3], ids=["white", "some walk", "a walk"])
def test_noise_is_no_drift(wander: float) -> None:
    """Forty data sets of two readings: as few small p-values as chance has, or fewer.

    Of 80, more than 18 below a tenth happen once in a thousand times where every tenth is.
    """
    found = [one.p_value() for seed in range(40) for one in drifts(*_setting(_noise(seed, wander)))]
    assert len(found) == 80
    assert sum(p < 0.1 for p in found) <= 18
    assert min(found) > ONE_IN_A_MILLION


@pytest.mark.parametrize(("wander", "size"), [(0.0, 30.0), (0.03, 100.0)], ids=["white", "some walk"])
@pytest.mark.parametrize("bend", [0.0, 1.0], ids=["steady", "warming up"])
def test_a_drift_is_heard_at_its_reading(bend: float, wander: float, size: float) -> None:
    """A drift of so many times the noise over a run, straight or as something warms up with half a run as its time.

    Noise that walks is whitened as if all were differences, of which a drift is a constant: it takes more.
    """
    time = np.arange(ROWS) / ROWS
    drift = time if not bend else (1.0 - np.exp(-2.0 * time)) / (1.0 - np.exp(-2.0))
    residuals = [noise + size * drift[:, None] * np.array([1.0, 0.0]) for noise in _noise(5, wander)]
    setting, fit = _setting(residuals)
    found = {one.where: one.p_value() for one in drifts(setting, fit)}
    assert found[AXES[0]] < ONE_IN_A_MILLION < found[AXES[1]]


def test_runs_that_wander_apart_have_no_drift_in_common() -> None:
    """Slopes of either sign, as large as a drift that is found: nothing that every run begins anew."""
    slope = np.arange(ROWS)[:, None] / ROWS * np.array([30.0, 0.0])
    residuals = [noise + by * slope for noise, by in zip(_noise(6), (1.0, -1.2, 0.3), strict=True)]
    assert all(one.p_value() > ONE_IN_A_MILLION for one in drifts(*_setting(residuals)))


def test_nothing_is_said_where_nothing_repeats() -> None:
    setting, fit = _setting(_noise(7))
    whitener = replace(setting.whitener, repeats=False)
    assert drifts(replace(setting, whitener=whitener), fit) == ()
