import numpy as np
import pytest

from analysis.measurements.loops import loop
from sim_backend.errors import DataError

COMPLIANCE = 0.0896  # rad per N m


def ellipse(n=2000, cycles=3, lag_rad=0.01):
    phase = 2.0 * np.pi * np.arange(n * cycles) / n
    return 0.05 * np.sin(phase), COMPLIANCE * 0.05 * np.sin(phase - lag_rad)


def test_an_ellipse_gives_its_width_area_and_compliance():
    lag = 0.01
    torque, angle = ellipse(lag_rad=lag)
    found = loop(torque, angle, 2000)
    # a cubic over a fifth of the amplitude misses the fourth power, at most 0.2^4/8 of the width
    assert found.remanence_ratio == pytest.approx(np.sin(lag), rel=2e-4)
    assert found.compliance_rad_nm == pytest.approx(COMPLIANCE * np.cos(lag), rel=1e-9)
    # pi · torque · quadrature part of the angle; the polygon of 2000 corners is smaller by (2 pi/2000)²/6
    assert found.area_j == pytest.approx(np.pi * 0.05 * COMPLIANCE * 0.05 * np.sin(lag), rel=1e-5)
    assert found.amplitude_rad == pytest.approx(COMPLIANCE * 0.05, rel=1e-5)
    np.testing.assert_allclose(found.deviation_rad @ found.torque_nm, 0.0, atol=1e-12)


def test_the_linear_plants_own_lag_is_no_hysteresis():
    rate_hz, lag_s = 1000.0, 3.14e-3
    torque, angle = ellipse(lag_rad=2.0 * np.pi * (rate_hz / 2000) * lag_s)
    found = loop(torque, angle, 2000, lag_s=lag_s, rate_hz=rate_hz)
    # the straight line between samples errs by (2 pi/2000)²/8 of the amplitude
    assert abs(found.remanence_ratio) < 2e-6


def test_remanence_with_noise_agrees_within_its_stated_uncertainty():
    rng = np.random.default_rng(6)
    torque, angle = ellipse(cycles=40)
    found = loop(torque, angle + 1e-6 * rng.normal(size=angle.size), 2000)
    expected = COMPLIANCE * 0.05 * np.sin(0.01)
    assert abs(found.remanence_rad - expected) < 4.0 * found.remanence_std_rad
    assert found.remanence_std_rad < 1e-7  # below the noise of one sample: several are averaged, over 40 cycles


def test_a_straight_spring_has_no_loop():
    torque, _ = ellipse()
    found = loop(torque, COMPLIANCE * torque, 2000)
    assert abs(found.remanence_rad) < 1e-15
    assert abs(found.area_j) < 1e-15


@pytest.mark.parametrize(
    ("torque", "period", "words"),
    [
        (np.full(100, 0.01), 50, "stays at 0.01 N m"),
        (1.0 + 0.1 * np.sin(np.arange(100)), 50, "does not pass zero"),
        (np.sin(np.arange(100)), 200, "shape"),
    ],
)
def test_what_is_no_loop_is_refused(torque, period, words):
    with pytest.raises(DataError, match=words):
        loop(torque, torque, period)
