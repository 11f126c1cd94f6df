"""Soft saturation against closed forms, its limits, and the numbers where powers would overflow."""

import numpy as np
import pytest

from sim_backend.effects import make_effect
from tests.sim_backend.effects.along import along

LIMIT = 0.03
COMMAND = np.linspace(-10.0, 10.0, 4001) * LIMIT


def given(command, **parameters):
    """What the amplifier gives: the command and what the effect adds."""
    return command + along(make_effect("soft-saturation", "theta_x", {"limit": LIMIT, **parameters}), signal=command)


@pytest.mark.parametrize("sharpness", [1.0, 2.0, 2.5, 7.3, 20.0])
def test_closed_form(sharpness):
    expected = COMMAND / (1.0 + np.abs(COMMAND / LIMIT) ** sharpness) ** (1.0 / sharpness)
    # twenty roundings of the powers
    np.testing.assert_allclose(given(COMMAND, sharpness=sharpness), expected, rtol=0, atol=20 * 2e-16 * 10 * LIMIT)


def test_between_a_hyperbolic_tangent_and_a_hard_limit():
    """The power mean of 1 and |u| differs from the smaller of both by ln 2 / n at most, where they are equal."""
    off = given(COMMAND, sharpness=2.5) - LIMIT * np.tanh(COMMAND / LIMIT)
    assert np.max(np.abs(off)) < 0.03 * LIMIT
    hard = given(COMMAND, sharpness=20.0) - np.clip(COMMAND, -LIMIT, LIMIT)
    assert np.max(np.abs(hard)) < LIMIT * np.log(2.0) / 20.0


def test_extreme_commands_stay_finite():
    """What is added takes all of a command of 1e200 away, and nothing of one of 1e-200."""
    far = np.array([-1e200, -1e-200, 0.0, 1e-200, 1e200])
    added = along(make_effect("soft-saturation", "theta_x", {"limit": LIMIT, "sharpness": 20.0}), signal=far)
    np.testing.assert_allclose(added, [1e200, 0.0, 0.0, 0.0, -1e200], rtol=1e-12)


def test_without_a_limit_nothing_is_added():
    assert not np.any(along(make_effect("soft-saturation", "theta_x", {}), signal=COMMAND))
