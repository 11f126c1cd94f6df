"""The covariance of a fit is the pseudo-inverse of its normal equations, whether all directions are known or not."""

import numpy as np
import pytest

from analysis.identification.normal_equations import TRIED, Normal, covariance, minimise


@pytest.mark.parametrize("unknown", [0, 2])
def test_covariance_is_the_pseudo_inverse(rng, unknown):
    jacobian = rng.normal(size=(50, 7 - unknown)) @ rng.normal(size=(7 - unknown, 7))
    hessian = jacobian.T @ jacobian
    size = np.sqrt(np.diag(hessian))
    units = np.geomspace(1e-6, 1e6, 7)
    found = covariance(Normal(1.0, np.zeros(7), hessian * np.outer(units, units)))
    want = np.linalg.pinv(hessian / np.outer(size, size), rcond=1e-12) / np.outer(size, size)
    # rounding of 1e-16 times the condition of the known directions, some thousands
    np.testing.assert_allclose(found * np.outer(units, units), want, rtol=0, atol=1e-10 * np.max(np.abs(want)))


@pytest.mark.parametrize(("hopeless", "given_up"), [(np.inf, False), (5.0, False), (1.0, True)])
def test_a_minimum_out_of_reach_is_given_up_after_a_few_steps(hopeless, given_up):
    """Rosenbrock's valley begins at four, and made a thousand times as narrow it takes hundreds of steps to its end."""

    def residual(x):
        return np.array([1e5 * (x[1] - x[0] ** 2), 1.0 - x[0]])

    def assemble(x):
        slope = np.array([[-2e5 * x[0], 1e5], [-1.0, 0.0]])
        r = residual(x)
        return Normal(float(r @ r), slope.T @ r, slope.T @ slope)

    found = minimise(
        assemble, lambda x: float(residual(x) @ residual(x)), np.array([-1.0, 1.0]), 400, hopeless=hopeless
    )
    assert (found.iterations == TRIED) == given_up
