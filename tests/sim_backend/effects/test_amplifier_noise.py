"""Amplifier noise: its size, and its spectrum against that of a first-order low pass."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sim_backend.effects import make_effect
from tests.sim_backend.effects.along import along

DT_S = 1e-4


def drawn(n, seed=0):
    return np.random.default_rng(seed).standard_normal(n)


def test_without_a_bandwidth_it_is_what_was_drawn():
    aux = drawn(1000)
    effect = make_effect("amplifier-noise", "theta_x", {"std": 0.3})
    # the filter's state takes y + (x - y), which rounds
    np.testing.assert_allclose(along(effect, aux=aux, dt_s=DT_S), 0.3 * aux, rtol=1e-12, atol=1e-15)


def test_low_pass_is_the_one_of_scipy():
    aux, corner_hz = drawn(1000), 80.0
    pole = np.exp(-2 * np.pi * corner_hz * DT_S)
    # unit variance: sum of (1 - pole)² pole^2k is (1 - pole) / (1 + pole)
    expected = 0.3 * np.sqrt((1 + pole) / (1 - pole)) * lfilter([1 - pole], [1, -pole], aux)
    effect = make_effect("amplifier-noise", "theta_x", {"std": 0.3, "bandwidth_hz": corner_hz})
    np.testing.assert_allclose(along(effect, aux=aux, dt_s=DT_S), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("corner_hz", [20.0, 100.0, 2000.0])
def test_std_is_that_of_the_noise_whatever_its_bandwidth(corner_hz):
    n = 2_000_000
    effect = make_effect("amplifier-noise", "theta_x", {"std": 1.0, "bandwidth_hz": corner_hz})
    pole = np.exp(-2 * np.pi * corner_hz * DT_S)
    # correlated samples: the variance estimate has relative variance 2/n (1 + pole²)/(1 - pole²); four of those
    margin = 4 * np.sqrt(2 / n * (1 + pole**2) / (1 - pole**2))
    assert np.var(along(effect, aux=drawn(n, 3), dt_s=DT_S)) == pytest.approx(1.0, rel=margin)
