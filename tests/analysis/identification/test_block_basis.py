import numpy as np
from scipy.linalg import expm
from scipy.signal import cont2discrete

from analysis.identification.block_basis import block_matrices, exponentials


def test_exponentials_match_scipy(rng):
    stack = rng.normal(size=(40, 6, 6)) * np.geomspace(1e-4, 5.0, 40)[:, None, None]
    wanted = expm(stack)
    # both lose about eps times the norm of the argument times that of the result
    for got, want in zip(exponentials(stack), wanted, strict=True):
        assert np.max(np.abs(got - want)) < 1e-12 * np.max(np.abs(want))


def test_held_block_matches_scipy_and_its_derivative_a_finite_difference():
    omega, sigma, rate = np.array([2000.0, 30.0]), np.array([15.0, 90.0]), 1000.0
    held = block_matrices(omega, sigma, rate)
    for i in range(2):
        a = np.array([[0.0, 1.0], [-(omega[i] ** 2), -2.0 * sigma[i]]])
        want = cont2discrete((a, np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1))), 1.0 / rate)
        assert np.allclose(held.a[i], want[0], rtol=1e-10, atol=1e-12)
        assert np.allclose(held.b[i], want[1][:, 0], rtol=1e-9, atol=1e-15)
    h = 1e-6
    for k, (do, ds) in enumerate(((h, 0.0), (0.0, h))):
        up = block_matrices(omega * np.exp(do), sigma * np.exp(ds), rate)
        down = block_matrices(omega * np.exp(-do), sigma * np.exp(-ds), rate)
        # central difference: error h^2 of the third derivative, and rounding eps / h
        assert np.allclose((up.a - down.a) / (2 * h), held.da[k], rtol=1e-7, atol=1e-7 * np.abs(held.da[k]).max())
        assert np.allclose((up.b - down.b) / (2 * h), held.db[k], rtol=1e-6, atol=1e-6 * np.abs(held.db[k]).max())


def test_rigid_body_is_held_exactly():
    held = block_matrices(np.zeros(1), np.zeros(1), 100.0)
    assert np.allclose(held.a[0], [[1.0, 0.01], [0.0, 1.0]], rtol=1e-14)
    assert np.allclose(held.b[0], [0.5e-4, 0.01], rtol=1e-14)
