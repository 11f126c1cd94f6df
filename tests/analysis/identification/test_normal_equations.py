"""The covariance of a fit is the pseudo-inverse of its normal equations, whether all directions are known or not."""

import numpy as np
import pytest

from analysis.identification.normal_equations import Normal, covariance


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
