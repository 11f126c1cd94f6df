"""The static gain's deviation is the one with which it scatters, and none is given where there is no gain."""

from __future__ import annotations

import numpy as np

from analysis.identification.modal_parameters import Structure
from analysis.identification.rational import fit_rational
from analysis.identification.static_gain import static_gain, static_gain_std
from sim_backend.linear import ModalModel

FITS = 150
FREQUENCY_HZ = np.arange(4.0, 60.0, 0.5)


def model() -> ModalModel:
    return ModalModel(
        2.0 * np.pi * np.array([10.0, 32.0]),
        np.array([3.0, 5.0]),
        np.ones((2, 1)),
        np.zeros((2, 1)),
        np.array([[900.0, 4000.0]]),
        np.array([[0.0, 3.0]]),
        np.array([[0.05]]),
        np.zeros(1),
    )


def test_it_scatters_by_its_deviation():
    """Of 150 fits the scatter is known to 6 %; three times that is allowed. A gain outside the band is extrapolated."""
    rng = np.random.default_rng(11)
    exact = model().frequency_response(FREQUENCY_HZ)
    variance = np.full(exact.shape, (0.02 * np.abs(exact).max()) ** 2)
    gains, stds = [], []
    for _ in range(FITS):
        noise = rng.standard_normal((2, *exact.shape)) * np.sqrt(0.5 * variance)
        fit = fit_rational(
            FREQUENCY_HZ, exact + noise[0] + 1j * noise[1], 2, variance=variance, structure=Structure(), start=model()
        )
        gain, std = static_gain(fit.model), static_gain_std(fit)
        assert gain is not None and std is not None
        gains.append(gain[0, 0])
        stds.append(std[0, 0])
    assert abs(np.std(gains) / np.mean(stds) - 1.0) < 0.18
    true = static_gain(model())
    assert true is not None and abs(np.mean(gains) - true[0, 0]) < 4.0 * np.std(gains) / np.sqrt(FITS)


def test_a_rigid_body_has_none():
    free = model().with_(omega_rad_s=np.array([0.0, 200.0]))
    assert static_gain(free) is None
