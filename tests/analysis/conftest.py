import numpy as np
import pytest

from sim_backend.linear import ModalModel


def make_plant(rng, blocks, n_y, n_u, mechanical, band_hz: tuple[float, float] = (20.0, 2500.0)):
    """A random stable plant whose modes all matter: unit participation, gains of one size at resonance."""
    omega = 2.0 * np.pi * np.geomspace(*band_hz, blocks) * rng.uniform(0.9, 1.1, blocks)
    sigma = omega * rng.uniform(0.005, 0.05, blocks)
    b, c = rng.normal(size=(blocks, n_u)), rng.normal(size=(n_y, blocks)) * omega**2
    direct, rate = rng.normal(size=b.shape) / omega[:, None], rng.normal(size=c.shape) * omega
    if mechanical:
        direct, rate = 0.0 * direct, 0.0 * rate
    d = np.zeros((n_y, n_u)) if mechanical else rng.normal(size=(n_y, n_u))
    return ModalModel(omega, sigma, b, direct, c, rate, d, np.zeros(n_u))


@pytest.fixture
def plant():
    return make_plant


@pytest.fixture
def rng():
    return np.random.default_rng(20)
