"""Friction with a give against Dahl's closed form and the sharp friction that it becomes."""

import numpy as np
import pytest

from sim_backend.effects import make_effect
from tests.sim_backend.effects.along import along

TORQUE_NM, GIVE = 0.3, 2e-6


def friction(give=GIVE):
    return make_effect("presliding-friction", "theta_x", {"torque": TORQUE_NM, "give": give})


def there_and_back(n):
    """From rest to ten gives, back to minus two, and to rest."""
    corners = GIVE * np.array([0.0, 10.0, -2.0, 0.0])
    lines = [np.linspace(a, b, n, endpoint=False) for a, b in zip(corners[:-1], corners[1:], strict=True)]
    return np.append(np.concatenate(lines), corners[-1])


@pytest.mark.parametrize("n", [2, 50], ids=["coarse", "fine"])
def test_every_branch_is_an_exponential_whatever_the_sampling(n):
    got = along(friction(), position=there_and_back(n))[::n]
    # f = end - (end - f0) exp(-path/give): from rest over 10, back over 12, on over 2 gives
    first = 1 - np.exp(-10.0)
    second = -1 + (first + 1) * np.exp(-12.0)
    third = 1 + (second - 1) * np.exp(-2.0)
    np.testing.assert_allclose(got, -TORQUE_NM * np.array([0.0, first, second, third]), rtol=1e-12, atol=1e-16)


def test_a_give_that_vanishes_is_the_sign_of_the_motion():
    x = np.sin(np.linspace(0.0, 20.0, 4000))
    torque = along(friction(1e-9), position=x)
    moving = np.abs(np.diff(x)) > 1e-7  # a hundred gives
    np.testing.assert_allclose(torque[1:][moving], -TORQUE_NM * np.sign(np.diff(x))[moving], rtol=1e-12)


def test_it_holds_where_nothing_moves():
    x = np.concatenate([np.linspace(0.0, 20 * GIVE, 100), np.full(100, 20 * GIVE)])
    torque = along(friction(), position=x)
    assert np.all(torque[100:] == torque[99]) and torque[99] == pytest.approx(-TORQUE_NM, rel=1e-8)


@pytest.mark.parametrize("amplitude", [0.2, 2.0, 200.0])
def test_energy_of_a_cycle(amplitude):
    a = amplitude * GIVE
    n = 4000
    x = a * np.concatenate([np.linspace(-1, 1, n)[:-1], np.linspace(1, -1, n)[:-1]])
    torque = along(friction(), position=np.tile(x, 20))
    last = np.append(torque[-2 * n + 2 :], torque[-2 * n + 2])
    work = np.trapezoid(last, np.append(x, x[0]))
    # steady: f runs from -t to t over 2a with t = tanh(a/give), and twice ∫ f dx is 4 (a - give t) of the torque;
    # the start is forgotten by exp(-80 amplitude); the trapezoid errs by (step/give)²/12 = 8e-4 of one give in 200
    assert work == pytest.approx(-4 * TORQUE_NM * (a - GIVE * np.tanh(amplitude)), rel=1e-5)
