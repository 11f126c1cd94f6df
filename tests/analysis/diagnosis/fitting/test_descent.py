"""Descent within bounds and the inverse that deviations come from, against scipy and a closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from analysis.diagnosis.fitting.descent import Descent, inverse_of

T = np.linspace(0, 1, 50)
DATA = 2.0 * np.exp(-3.0 * T) + 0.01 * np.sin(40 * T)


class Point:
    """What an exponential of size x₀ and rate x₁ leaves of `DATA`."""

    def __init__(self, x: np.ndarray) -> None:
        self.r = DATA - x[0] * np.exp(-x[1] * T)
        self.objective = float(self.r @ self.r) * 1e6


class Along:
    """The slopes of a `Point`: those of another place or wrong ones until better ones are asked for."""

    def __init__(self, wrong: float = 1.0) -> None:
        self.wrong, self.asked, self.kept = wrong, 0, None

    def normal(self, x: np.ndarray, at: Point) -> tuple[np.ndarray, np.ndarray]:
        j = np.column_stack([np.exp(-x[1] * T), -self.wrong * x[0] * T * np.exp(-x[1] * T)])
        return 1e6 * j.T @ j, 1e6 * j.T @ at.r

    def fresh(self) -> bool:
        return True

    def truer(self) -> bool:
        self.asked += 1
        better, self.wrong = self.wrong != 1.0, 1.0
        return better

    def failed(self) -> bool:
        return self.truer()


def expected(upper: np.ndarray) -> np.ndarray:
    return least_squares(lambda p: DATA - p[0] * np.exp(-p[1] * T), [1, 1], bounds=(-upper, upper)).x


def descended(slopes: Along, upper: np.ndarray, *, exact: bool = True) -> np.ndarray:
    cap = np.full(2, 1.0)
    return Descent(Point, slopes, -upper, upper, cap, exact=exact).run(np.array([1.0, 1.0]), 500)[0]


@pytest.mark.parametrize("upper", [np.full(2, np.inf), np.array([np.inf, 2.5])], ids=["free", "bounded"])
def test_descent_finds_what_scipy_finds(upper) -> None:
    np.testing.assert_allclose(descended(Along(), upper), expected(upper), rtol=1e-3)


@pytest.mark.parametrize("wrong", [-1.0, 0.3, 5.0])
def test_wrong_slopes_are_given_up_for_true_ones(wrong) -> None:
    """A column of the wrong sign leads up, one of the wrong length to a crawl: neither may end a descent."""
    slopes, upper = Along(wrong), np.full(2, np.inf)
    np.testing.assert_allclose(descended(slopes, upper), expected(upper), rtol=1e-3)
    assert slopes.asked


class Bowl:
    """A million (x - 1)²."""

    def __init__(self, x: np.ndarray) -> None:
        self.objective = 1e6 * float((x[0] - 1.0) ** 2)


class TenTimes:
    """The slopes of a `Bowl`: its column ten times as long as it is, until truer ones are asked for."""

    def __init__(self) -> None:
        self.true = False

    def normal(self, x: np.ndarray, at: Bowl) -> tuple[np.ndarray, np.ndarray]:
        times = 1.0 if self.true else 10.0
        return 1e6 * np.full((1, 1), times**2), 1e6 * times * (1.0 - x)

    def fresh(self) -> bool:
        return True

    def truer(self) -> bool:
        return False

    def failed(self) -> bool:
        better, self.true = not self.true, True
        return better


def test_steps_that_keep_little_of_their_promise_at_any_length_are_the_fault_of_the_slopes() -> None:
    """Each of them helps a little, and half as much as the one before: without end, and never far."""
    slopes, far = TenTimes(), np.full(1, np.inf)
    _, found = Descent(Bowl, slopes, -far, far, far).run(np.zeros(1), 5)
    assert slopes.true
    assert found.objective < 1e-3


def test_a_rough_descent_that_ends_freely_asks_for_nothing() -> None:
    slopes, upper = Along(), np.full(2, np.inf)
    np.testing.assert_allclose(descended(slopes, upper, exact=False), expected(upper), rtol=1e-3)
    assert not slopes.asked


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
