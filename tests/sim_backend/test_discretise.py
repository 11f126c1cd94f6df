"""What a block does in a sample, against the exponential of its matrix by another hand (Padé's, in scipy)."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel, discretise

RATE_HZ = 1000.0


def blocks(omega_rad_s: list[float], sigma_1_s: list[float]) -> ModalModel:
    """Return blocks with inputs into position and rate, and outputs of both."""
    m = len(omega_rad_s)
    rng = np.random.default_rng(7)
    b, b_direct = rng.normal(size=(2, m, 2))
    c, c_rate = rng.normal(size=(2, 3, m))
    return ModalModel(
        np.array(omega_rad_s), np.array(sigma_1_s), b, b_direct, c, c_rate, np.zeros((3, 2)), np.array([0.0, 0.4e-3])
    )


CASES = {
    "light": (300.0, 2.0),
    "undamped": (40.0, 0.0),
    "rigid": (0.0, 0.0),
    "rigid in oil": (0.0, 80.0),
    "critical": (50.0, 50.0),
    "two real poles": (20.0, 4000.0),
    "many turns a sample": (60_000.0, 30.0),
    "slow": (1e-3, 1e-5),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("beside", [[], ["light", "two real poles"]], ids=["alone", "beside others"])
def test_a_block_moves_as_the_exponential_of_its_matrix_says(case: str, beside: list[str]) -> None:
    pairs = [CASES[name] for name in (case, *beside)]
    linear = blocks([omega for omega, _ in pairs], [sigma for _, sigma in pairs])
    found = discretise(linear, RATE_HZ, split=True)
    omega, sigma = CASES[case]
    matrix = np.zeros((4, 4))
    matrix[:2, :2] = [[0.0, 1.0], [-(omega**2), -2.0 * sigma]]
    matrix[0, 2:], matrix[1, 2:] = linear.b_direct[0], linear.b[0]
    # in units in which a sample's angle is the largest entry, or scipy's halvings cost digits
    unit = np.diag([1.0, max(omega, 2.0 * sigma, 1.0), 1.0, 1.0])
    exact = unit @ scipy.linalg.expm(np.linalg.solve(unit, matrix @ unit) / RATE_HZ) @ np.linalg.inv(unit)
    scale = np.abs(exact[:2]).max(axis=1)[:, None]
    np.testing.assert_allclose(found.a[0] / scale, exact[:2, :2] / scale, atol=2e-13)
    np.testing.assert_allclose(found.b[0] / scale, exact[:2, 2:] / scale, atol=2e-13)
    # the second input's older sample acts for the first 0.4 of a sample, the newer for the rest
    newer = unit @ scipy.linalg.expm(np.linalg.solve(unit, matrix @ unit) * 0.6 / RATE_HZ) @ np.linalg.inv(unit)
    assert found.late is not None
    np.testing.assert_allclose(found.late[0, :, 1] / scale[:, 0], (exact - newer)[:2, 3] / scale[:, 0], atol=2e-13)


def test_a_block_is_the_same_whatever_is_beside_it() -> None:
    alone = discretise(blocks([300.0], [2.0]), RATE_HZ)
    beside = discretise(blocks([300.0, 60_000.0], [2.0, 30.0]), RATE_HZ)
    assert np.array_equal(alone.a[0], beside.a[0])


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("omega_rad_s", [1.0, -2.0], "omega_rad_s of block 2 is -2"),
        ("delay_s", [-1e-3, 0.0], "delay_s of input 1 is -0.001"),
    ],
)
def test_a_negative_number_is_refused_by_name_and_place(name: str, values: list[float], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        blocks([1.0, 2.0], [0.1, 0.1]).with_(**{name: np.array(values)})
