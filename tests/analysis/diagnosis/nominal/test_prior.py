"""What is known beforehand of the nuisances, against nominal models whose every number is wrong by a part of its
own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.nominal.tuning import (
    covariance_of,
    factor_of,
    mahalanobis2_of,
    nuisances_of,
    own_nuisances_of,
    root_of,
    spreads_of,
)
from sim_backend.linear import ModalModel
from tests.analysis.diagnosis.two_modes import linear_model

TOLERANCE = 0.02
FIELDS = ("omega_rad_s", "sigma_1_s", "b", "c")


def two_axes(held: float = 1.1) -> ModalModel:
    """Two modes, each driven by two inputs and seen in two readings; the larger participation of each is `held`."""
    return ModalModel(
        omega_rad_s=2.0 * np.pi * np.array([20.0, 35.0]),
        sigma_1_s=np.array([4.0, 9.0]),
        b=np.array([[3000.0, -50.0], [80.0, 2500.0]]),
        b_direct=np.zeros((2, 2)),
        c=np.array([[held, 0.04], [-0.03, -held]]),
        c_rate=np.zeros((2, 2)),
        d=np.zeros((2, 2)),
        delay_s=np.zeros(2),
    )


def changes(truth: ModalModel, rng: np.random.Generator, exact: float | None = None) -> np.ndarray:
    """Return the change of the nuisances that makes `truth`, up to the modes' scales, of a nominal model with
    errors."""

    def wrong(values: np.ndarray) -> np.ndarray:
        found = values * np.exp(TOLERANCE * rng.standard_normal(values.shape))
        return found if exact is None else np.where(np.abs(values) == exact, values, found)

    nominal = truth.with_(**{name: wrong(getattr(truth, name)) for name in FIELDS})
    m = np.arange(truth.n_blocks)
    largest = np.argmax(np.abs(nominal.c), axis=0)
    scale = nominal.c[largest, m] / truth.c[largest, m]
    same = truth.with_(c=truth.c * scale, b=truth.b / scale[:, None])
    nuisances = nuisances_of(nominal, TOLERANCE)
    return np.array([k.change(getattr(nominal, k.field)[k.index], getattr(same, k.field)[k.index]) for k in nuisances])


@pytest.mark.parametrize("held", [1.1, 1.0], ids=["a number like all others", "a scale"])
def test_covariance_is_that_of_models_whose_numbers_are_wrong_one_by_one(rng, held):
    truth = two_axes(held)
    drawn = np.array([changes(truth, rng, exact=1.0) for _ in range(20_000)])
    expected = covariance_of(nuisances_of(truth, TOLERANCE))
    # 20,000 draws leave 1 % on a variance and 0.7 % of a product of deviations on a covariance, one sigma
    assert np.max(np.abs(np.cov(drawn.T) - expected)) < 5.0 * 0.02 * TOLERANCE**2
    distances2 = [mahalanobis2_of(nuisances_of(truth, TOLERANCE), change) for change in drawn[:2000]]
    assert np.mean(distances2) == pytest.approx(drawn.shape[1], abs=5.0 * np.sqrt(2.0 * drawn.shape[1] / 2000.0))


def test_a_sensor_whose_numbers_are_all_too_small_by_as_much_is_no_long_way_off():
    # two numbers, drive and reading, share what is wrong with their product: its variance is twice that of one
    linear = linear_model().with_(c=np.array([[1.1, 1.1]]), c_rate=np.zeros((1, 2)))
    nuisances = nuisances_of(linear, TOLERANCE)
    drives = np.array([nuisance.field == "b" for nuisance in nuisances])
    change = np.where(drives, 2.0 * TOLERANCE, 0.0)
    assert mahalanobis2_of(nuisances, change) == pytest.approx(2.0 * 2.0**2 / 2.0)
    assert mahalanobis2_of([replace(k, loading=0.0) for k in nuisances], change) == pytest.approx(2.0 * 2.0**2)


def test_root_and_factor_are_those_of_the_covariance():
    nuisances = nuisances_of(two_axes(), TOLERANCE)
    covariance = covariance_of(nuisances)
    np.testing.assert_allclose(factor_of(nuisances) @ factor_of(nuisances).T, covariance, rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(
        root_of(nuisances) @ covariance @ root_of(nuisances).T, np.eye(len(nuisances)), atol=1e-12
    )
    np.testing.assert_allclose(spreads_of(nuisances) ** 2, np.diag(covariance))


def test_modes_and_fitted_numbers_are_independent():
    nuisances = nuisances_of(two_axes(), TOLERANCE)
    mode = np.array([nuisance.mode for nuisance in nuisances])
    assert not covariance_of(nuisances)[mode[:, None] != mode].any()
    own = own_nuisances_of(two_axes())
    np.testing.assert_array_equal(covariance_of(own), np.diag([k.sd**2 for k in own]))
    assert covariance_of([]).shape == root_of([]).shape == (0, 0) and mahalanobis2_of([], np.zeros(0)) == 0.0
