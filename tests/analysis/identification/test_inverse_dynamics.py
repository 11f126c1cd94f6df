"""The balance of torques against the axis it was played on, and its silence where friction is not what matters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from analysis.identification.inverse_dynamics import balance_of
from analysis.identification.pushed import pushed
from tests.analysis.identification.rubbing_axis import CONSTANT, DAMPING, FRICTION, MASS, RATE_HZ, play


def test_the_numbers_of_an_axis_that_rubs_are_found() -> None:
    u, y = play(12.0, 3)
    found = balance_of([u[:, None]], [y[:, None]], RATE_HZ)
    assert found is not None
    # a noise of 2 µm on moves of 0.1 m alone would allow 1e-4; a derivative of its own smoothing is 1e-2 off
    assert 1.0 / found.linear.b[0, 0] == pytest.approx(MASS, rel=1e-3)
    assert 2.0 * found.linear.sigma_1_s[0] / found.linear.b[0, 0] == pytest.approx(DAMPING, rel=1e-3)
    assert found.friction == pytest.approx(FRICTION, rel=1e-3)
    # what the balance calls constant is what pulls beside the drive
    assert found.constant == pytest.approx(-CONSTANT, abs=1e-3)
    assert found.linear.omega_rad_s[0] < 0.3 * found.linear.sigma_1_s[0]  # nothing holds it


def test_what_holds_an_axis_at_rest_is_no_friction_in_motion() -> None:
    """Most of what the drive plays is a friction that is at its limit only while the axis moves."""
    u, y = play(12.0, 3, friction=5.0 * FRICTION)
    found = balance_of([u[:, None]], [y[:, None]], RATE_HZ)
    assert found is not None
    # a fifth of the rows is left: those around which it moves throughout
    assert found.friction == pytest.approx(5.0 * FRICTION, rel=2e-3)
    assert 1.0 / found.linear.b[0, 0] == pytest.approx(MASS, rel=2e-3)


def test_of_an_axis_without_friction_the_balance_tells_what_pushes_it() -> None:
    u, y = play(12.0, 3, friction=0.0)
    found = balance_of([u[:, None]], [y[:, None]], RATE_HZ)
    assert found is not None
    assert found.friction == 0.0
    assert found.constant == pytest.approx(-CONSTANT, rel=2e-3)
    exact = pushed(found, [u[:, None]], [y[:, None]], RATE_HZ)
    assert abs(exact.constant + CONSTANT) < 4.0 * exact.constant_std < 1e-4
    gain = exact.linear.c[0, 0] * exact.linear.b[0, 0]
    assert 1.0 / gain == pytest.approx(MASS, rel=1e-5)
    assert 2.0 * exact.linear.sigma_1_s[0] / gain == pytest.approx(DAMPING, rel=1e-5)


def test_an_oscillator_has_no_such_balance() -> None:
    omega, damping = 2.0 * np.pi * 20.0, 0.05
    u = np.random.default_rng(1).standard_normal(4000)
    matrices = ([[0.0, 1.0], [-(omega**2), -2.0 * damping * omega]], [[0.0], [omega**2]], [[1.0, 0.0]], [[0.0]])
    a, b, c, d, dt = cont2discrete(tuple(np.array(m) for m in matrices), 1.0 / RATE_HZ)
    _, y, _ = dlsim((a, b, c, d, dt), u)
    assert balance_of([u[:, None]], [y], RATE_HZ) is None


def test_of_other_drives_what_acts_on_the_axis_is_told() -> None:
    u, y = play(12.0, 3, friction=0.0)
    idle, acting = np.random.default_rng(8).standard_normal((2, u.size))
    # the drive that is recorded gives less than what moves the axis: a tenth of the other one does the rest
    found = balance_of([np.stack([u - 0.1 * acting, idle, acting], axis=1)], [y[:, None]], RATE_HZ)
    assert found is not None
    own, nothing, other = found.linear.b[0]
    assert nothing == 0.0
    assert other / own == pytest.approx(0.1, rel=0.05)
    assert 1.0 / own == pytest.approx(MASS, rel=1e-2)


def test_several_readings_have_no_balance() -> None:
    u, y = play(3.0, 3)
    assert balance_of([u[:, None]], [np.stack([y, y], axis=1)], RATE_HZ) is None


def test_a_record_starts_where_the_cubic_through_its_first_rows_does() -> None:
    u, y = play(12.0, 3)
    found = balance_of([u[:, None]], [y[:, None]], RATE_HZ)
    assert found is not None
    t = np.arange(y.size) / RATE_HZ
    position, rate = found.starts(0.3 - 0.2 * t + 5.0 * t**2 - 40.0 * t**3, RATE_HZ)
    assert position == pytest.approx(0.3, rel=1e-9) and rate == pytest.approx(-0.2, rel=1e-6)
