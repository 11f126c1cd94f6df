"""The regression finds the cube of the rate where it acts, and nothing in a linear record."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.rate_cubed import compare


@pytest.mark.parametrize("cubed", [0.0, 0.5])
def test_only_a_cube_that_acts_is_found(cubed):
    rng = np.random.default_rng(3)
    u, rate, position, y = rng.standard_normal(1200), 0.0, 0.0, np.zeros(1200)
    for k in range(u.size):
        force = u[k] - 0.1 * rate - 0.3 * position - cubed * rate**3 / 10.0
        y[k], rate = force + 0.01 * rng.standard_normal(), rate + 0.1 * force
        position += 0.1 * rate
    _, chance, part = compare(u, y, 900, 8)
    assert (chance < 1e-6) == (part < 0.95) == (cubed > 0.0)
