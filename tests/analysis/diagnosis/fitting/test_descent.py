"""Descent within bounds and the inverse that deviations come from, against scipy and a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from analysis.diagnosis.fitting.descent import Descent, inverse_of


def test_descent_finds_what_scipy_finds() -> None:
    t = np.linspace(0, 1, 50)
    data = 2.0 * np.exp(-3.0 * t) + 0.01 * np.sin(40 * t)

    class Point:
        def __init__(self, x: np.ndarray) -> None:
            self.r = data - x[0] * np.exp(-x[1] * t)
            self.objective = float(self.r @ self.r) * 1e6

    def normal(x: np.ndarray, at: Point) -> tuple[np.ndarray, np.ndarray]:
        j = np.column_stack([np.exp(-x[1] * t), -x[0] * t * np.exp(-x[1] * t)])
        return 1e6 * j.T @ j, 1e6 * j.T @ at.r

    high = np.array([np.inf, 2.5])
    for upper in (np.full(2, np.inf), high):
        x, _ = Descent(Point, normal, -upper, upper, np.full(2, 1.0)).run(np.array([1.0, 1.0]), 50)
        expected = least_squares(lambda p: data - p[0] * np.exp(-p[1] * t), [1, 1], bounds=(-upper, upper)).x
        np.testing.assert_allclose(x, expected, rtol=1e-3)


def test_what_only_the_prior_determines_keeps_its_deviation_beside_what_is_known_to_many_digits() -> None:
    """Two columns that are the same, 10⁴ strong, each with a prior of one; the third is known to 3e-8 of its prior.

    [[1 + a, a], [a, 1 + a]] has the inverse [[1 + a, -a], [-a, 1 + a]] / (1 + 2 a): half, and minus half.
    """
    a, strong = 1e8, 1e15
    precision = np.array([[1.0 + a, a, 0.0], [a, 1.0 + a, 0.0], [0.0, 0.0, strong]])
    covariance = inverse_of(precision)
    # the scaled matrix is known to 1e-16, its smallest eigenvalue is 1e-8
    np.testing.assert_allclose(covariance[:2, :2], [[0.5, -0.5], [-0.5, 0.5]], rtol=1e-7)
    assert covariance[2, 2] == pytest.approx(1.0 / strong)
