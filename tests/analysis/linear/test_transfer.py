import numpy as np
import pytest
from scipy import signal

from analysis.linear.transfer import polynomials
from sim_backend.linear import ModalModel
from sim_backend.polynomial import modal_from_polynomial

THETA_Y = ((2.53e14,), (1.0, 77.80, 8.19e7, 7.77e8, 2.76e12))
THETA_X = (
    (5.11e14, 3.72e16, 4.95e21, 1.00e23, 2.77e27),
    (1.0, 178.5, 1.68e8, 1.45e10, 1.60e15, 4.85e16, 9.51e20, 9.71e21, 3.09e25),
)


@pytest.mark.parametrize(("numerator", "denominator"), [THETA_Y, THETA_X])
def test_the_printed_coefficients_come_back_from_their_modes(numerator, denominator):
    found_n, found_d = polynomials(modal_from_polynomial(numerator, denominator))
    # factoring loses half of the 16 digits where roots lie close; 1e-6 is far below the printed three digits
    np.testing.assert_allclose(found_d[::-1], denominator, rtol=1e-6)
    np.testing.assert_allclose(found_n[: len(numerator)][::-1], numerator, rtol=1e-6)


def test_blocks_with_direct_input_and_rate_equal_the_state_space():
    rng = np.random.default_rng(1)
    model = ModalModel(
        np.array([10.0, 25.0]),
        np.array([0.5, 3.0]),
        rng.normal(size=(2, 1)),
        rng.normal(size=(2, 1)),
        rng.normal(size=(1, 2)),
        rng.normal(size=(1, 2)),
        np.array([[0.3]]),
        np.zeros(1),
    )
    numerator, denominator = signal.ss2tf(*model.state_space())
    found_n, found_d = polynomials(model)
    np.testing.assert_allclose(found_d[::-1], denominator, rtol=1e-10)
    np.testing.assert_allclose(found_n[::-1], numerator[0], rtol=1e-8, atol=1e-8 * np.abs(numerator).max())
