"""What section 6.3.2 says of the learning filter, recomputed from its printed digits."""

import numpy as np
from scipy import signal
from scipy.optimize import least_squares

from sim_backend.control.feedback import theta_controller
from sim_backend.control.repetitive import TABLE_6_5, convergence, learning_filter, process_sensitivity
from tests.sim_backend.paper_plants import RATE_HZ, STATIC_GAIN, theta_x, theta_y

PRINTED_NUM = np.array([0.048, 6.253e-5, -0.096, -2.939e-5, 0.048])
PRINTED_DEN = np.array([1.0, -3.187, 3.876, -2.124, 0.441])
HALF_NUM = np.array([5e-4, 5e-9, 5e-4, 5e-9, 5e-4])
HALF_DEN = 5e-4
GAIN_Y = 2.53e14 / 2.76e12 * 1e-3


def _numerator(learning):
    """Numerator over the printed denominator's order, N m per mrad, from the poles and the response at five points."""
    z = np.exp(2j * np.pi * np.arange(5) / 5 + 0.3j)
    f = np.angle(z) / (2 * np.pi) * RATE_HZ
    denominator = np.poly(learning.poles()).real
    values = learning.frequency_response(f) * np.polyval(denominator, z)
    return np.linalg.solve(np.vander(z, 5), values).real * 1e-3, denominator


def test_denominator_is_a_butterworth_of_fourth_order_at_500_hz_and_10_khz():
    poles = 2 * np.pi * 500.0 * np.exp(1j * np.pi * (0.5 + (np.arange(4) + 0.5) / 4))
    for rate_hz, agrees in ((10_000.0, True), (9_900.0, False), (10_100.0, False)):
        den = np.poly(signal.bilinear_zpk([], poles, 1.0, rate_hz)[1]).real
        assert bool(np.all(np.abs(den - PRINTED_DEN) <= HALF_DEN)) is agrees


def test_numerator_inverts_one_mode_at_29_58_hz():
    """Frequency, decay and gain solved from the leading digit and the two small coefficients, which carry four digits.

    The leading digit, 0.048 within half a unit, leaves the frequency uncertain by 0.15 Hz and the decay by
    0.05 1/s.
    """

    def off(x, leading):
        num, _ = _numerator(learning_filter([2 * np.pi * x[0]], [x[1]], x[2], 500.0, RATE_HZ))
        return (num[[0, 1, 3]] - [leading, PRINTED_NUM[1], PRINTED_NUM[3]]) / [1e-3, 1e-6, 1e-6]

    found = [least_squares(off, [29.6, 4.8, 0.1], x_scale=[1, 1, 0.01], args=(k,)).x for k in (0.0475, 0.048, 0.0485)]
    assert np.allclose([x[0] for x in found], [29.73, 29.58, 29.43], atol=0.01)
    assert np.allclose([x[1] for x in found], [4.84, 4.79, 4.74], atol=0.01)
    assert np.allclose([x[2] for x in found], 97.6e-3, atol=0.05e-3)
    # the decay is theta_x's (4.789), the frequency either axis's or neither's
    assert np.isclose(theta_x().sigma_1_s[0], 4.79, atol=0.005)


def test_its_digits_come_back_and_its_gain_is_neither_plants():
    """29.579 Hz and 4.790 1/s, but a plant gain of 97.6 mrad/N m: 8.9 % above theta_x's, 6.5 % above theta_y's."""
    num, _ = _numerator(learning_filter([2 * np.pi * 29.579], [4.7902], 97.6228e-3, 500.0, RATE_HZ))
    assert np.all(np.abs(num - PRINTED_NUM) <= HALF_NUM)
    for gain in (STATIC_GAIN, GAIN_Y):
        num, _ = _numerator(learning_filter([2 * np.pi * 29.579], [4.7902], gain, 500.0, RATE_HZ))
        assert not np.all(np.abs(num - PRINTED_NUM) <= HALF_NUM)
    assert np.isclose(97.62e-3 / STATIC_GAIN, 1.089, atol=0.001)


def test_the_fourth_order_inverse_that_the_text_describes_has_other_digits():
    plant = theta_y()
    num, _ = _numerator(learning_filter(plant.omega_rad_s, plant.sigma_1_s, GAIN_Y, 500.0, RATE_HZ))
    assert np.allclose(num, [0.309, -1.025, 1.430, -1.021, 0.307], atol=5e-4)


def test_learning_with_the_printed_tuning_breaks_the_rule_of_monotonic_convergence():
    """Section 6.5 says that the rule is ignored: without Q, |1 - z^gamma P k_r L| exceeds 1 above the learning band."""
    f = np.geomspace(5.0, 4990.0, 4000)
    cases = ((theta_x(), "theta_x", STATIC_GAIN, 2228.0, 1.0000), (theta_y(), "theta_y", GAIN_Y, 1290.0, 1.131))
    for plant, axis, gain, first_hz, worst in cases:
        tuning = TABLE_6_5[axis]
        learning = learning_filter(plant.omega_rad_s[:1], plant.sigma_1_s[:1], gain, tuning.cutoff_hz, RATE_HZ)
        p = plant.frequency_response(f, RATE_HZ)[:, 0, 0]
        shrink = convergence(f, p, learning, tuning.gain, tuning.lead_samples)
        assert np.isclose(f[shrink > 1.0].min(), first_hz, rtol=0.01)
        # the resonance is 0.4 % wide, the grid 0.17 %
        assert np.isclose(shrink.max(), worst, atol=0.003)
        assert np.all(shrink[f < 1000.0] < 1.0)


def test_learning_with_the_feedback_closed_would_need_the_inverse_of_s_p():
    """Why the loop is closed only after learning: with it L no longer fits, and errors grow above the resonance."""
    f = np.geomspace(5.0, 100.0, 500)
    tuning = TABLE_6_5["theta_y"]
    plant = theta_y()
    learning = learning_filter(plant.omega_rad_s[:1], plant.sigma_1_s[:1], GAIN_Y, tuning.cutoff_hz, RATE_HZ)
    p = plant.frequency_response(f, RATE_HZ)[:, 0, 0]
    c = theta_controller().frequency_response(f)
    closed = convergence(f, process_sensitivity(p, c), learning, tuning.gain, tuning.lead_samples)
    assert closed.max() > 1.0
    assert convergence(f, p, learning, tuning.gain, tuning.lead_samples).max() < 1.0


def test_the_lead_takes_back_the_delay_of_the_low_pass():
    """A 4th-order Butterworth delays by 2.613/(2 pi 500 Hz) = 8.3 samples, the hold by half of one: 8 or 9 samples."""
    low_pass_delay = RATE_HZ * 2 * (np.cos(np.pi / 8) + np.cos(3 * np.pi / 8)) / (2 * np.pi * 500.0)
    assert 8.0 < low_pass_delay + 0.5 < 9.0
    assert {t.lead_samples for t in TABLE_6_5.values()} == {8, 9}
