"""Two modes in each other's place are the same model, and no farther from the nominal one than they are."""

from __future__ import annotations

import numpy as np

from analysis.diagnosis.fitting.modes import numbered
from analysis.diagnosis.nominal.tuning import change_to, mahalanobis2_of, nuisances_of, turned
from sim_backend.linear import ModalModel


def _close_modes() -> ModalModel:
    return ModalModel(
        omega_rad_s=2 * np.pi * np.array([100.0, 371.0, 383.0]),
        sigma_1_s=np.array([90.0, 8.6, 29.0]),
        b=np.array([[0.6, 0.1], [0.49, 0.2], [0.18, 0.3]]),
        b_direct=np.zeros((3, 2)),
        c=np.array([[1.004, 1.01, 0.5], [0.3, 0.4, 0.98]]),
        c_rate=np.zeros((2, 3)),
        d=np.zeros((2, 2)),
        delay_s=np.zeros(2),
    )


def test_modes_that_have_changed_places_are_numbered_as_before() -> None:
    nominal = _close_modes()
    nuisances = nuisances_of(nominal, 0.03)
    right = 0.02 * np.random.default_rng(1).standard_normal(len(nuisances))
    bench = turned(nominal, nuisances, right)
    # each takes the other's place, with participations that make the same of their products
    order, part = [0, 2, 1], np.array([1.0, bench.c[0, 1] / bench.c[0, 2], bench.c[1, 2] / bench.c[1, 1]])
    wrong = bench.with_(
        omega_rad_s=bench.omega_rad_s[order],
        sigma_1_s=bench.sigma_1_s[order],
        b=bench.b[order] / part[:, None],
        c=bench.c[:, order] * part,
    )
    exchanged = change_to(nominal, nuisances, wrong)
    assert mahalanobis2_of(nuisances, exchanged) > 100.0 * mahalanobis2_of(nuisances, right)
    np.testing.assert_allclose(numbered(nominal, nuisances, exchanged), right, atol=1e-12)


def test_what_is_likeliest_as_it_is_stays() -> None:
    nominal = _close_modes()
    nuisances = nuisances_of(nominal, 0.03)
    change = 0.02 * np.random.default_rng(2).standard_normal(len(nuisances))
    assert numbered(nominal, nuisances, change) is change
