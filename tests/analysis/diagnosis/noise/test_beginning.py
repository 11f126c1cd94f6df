"""The first rows of a series of slow noise, against the covariance of the noise itself."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz
from scipy.signal import lfilter

from analysis.diagnosis.noise.whitener import Whitener


def _covariance(taps: np.ndarray, n: int) -> np.ndarray:
    """Return the covariance (n, n) of the noise that `taps` whiten, from what one innovation makes of it."""
    answer = lfilter([1.0], taps, np.eye(1, 20_000)[0])
    return np.asarray(toeplitz([answer[: answer.size - k] @ answer[k:] for k in range(n)]))


def test_first_rows_are_whitened_as_their_covariance_says() -> None:
    taps = 1e5 * np.convolve(np.convolve([1.0, -0.995], [1.0, -0.6]), [1.0, 0.3])
    n = 12
    exact = solve_triangular(cholesky(_covariance(taps, n), lower=True), np.eye(n), lower=True)
    whitener = Whitener(taps[None], False)
    np.testing.assert_allclose(whitener.apply(np.eye(n), 0), exact, rtol=1e-6, atol=1e-6 * taps[0])
    # twice the logarithm of the determinant of what whitens is minus that of the covariance
    expected = -2.0 * np.sum(np.log(np.diag(exact)))
    np.testing.assert_allclose(whitener.log_variance(np.ones(n, dtype=bool)), expected, rtol=1e-9)


def test_an_offset_is_known_no_better_than_slow_noise_lets_it() -> None:
    taps, n = np.array([1.0, -0.999]), 200
    offset = np.ones((n, 1))
    known = float(np.sum(Whitener(taps[None], False).apply(offset, 0) ** 2))
    exact = float(offset[:, 0] @ np.linalg.solve(_covariance(taps, n), offset[:, 0]))
    np.testing.assert_allclose(known, exact, rtol=1e-6)


def test_rows_of_a_noise_that_grows_without_bound_count_nothing_at_first() -> None:
    walk = Whitener(np.array([[1.0, -1.0]]), False)
    np.testing.assert_array_equal(walk.apply(np.ones((5, 1)), 0), np.zeros((5, 1)))
