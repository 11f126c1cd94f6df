import control
import numpy as np
import pytest

from analysis.linear.modal_form import balanced_truncation, canonical, modal_from_state_space
from sim_backend.errors import DataError
from sim_backend.linear import ModalModel


def _response(system, frequency_hz):
    return np.stack([system(2j * np.pi * f, squeeze=False) for f in frequency_hz])


def test_state_space_keeps_its_response(rng):
    # complex pairs, real poles and a stiff scale, against python-control
    a = np.diag([-3.0, -700.0, -20.0, -25.0])
    a = np.block([[a, np.zeros((4, 2))], [np.zeros((2, 4)), np.array([[-2.0, 400.0], [-400.0, -2.0]])]])
    turn = rng.normal(size=(6, 6))
    a = turn @ a @ np.linalg.inv(turn)
    b, c, d = rng.normal(size=(6, 2)), rng.normal(size=(3, 6)), rng.normal(size=(3, 2))
    model = modal_from_state_space(a, b, c, d)
    f = np.geomspace(0.1, 1000.0, 50)
    want = _response(control.ss(a, b, c, d), f)
    assert np.allclose(model.frequency_response(f), want, rtol=1e-7, atol=1e-9 * np.abs(want).max())


def test_unstable_poles_are_reflected_and_odd_orders_refused():
    model = modal_from_state_space(np.diag([2.0, -5.0]), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)))
    assert np.all(model.poles_1_s().real < 0.0)
    with pytest.raises(DataError, match="odd order 3"):
        modal_from_state_space(-np.eye(3), np.ones((3, 1)), np.ones((1, 3)), np.zeros((1, 1)))


def test_canonical_keeps_the_response_and_fixes_the_strongest_input(rng, plant):
    model = plant(rng, 4, 3, 2, False)
    same = canonical(model)
    f = np.geomspace(10.0, 3000.0, 60)
    want = model.frequency_response(f)
    assert np.allclose(same.frequency_response(f), want, rtol=1e-9, atol=1e-11 * np.abs(want).max())
    for i in range(4):
        assert np.any((same.b[i] == 1.0) & (same.b_direct[i] == 0.0))


def test_canonical_form_of_a_rotated_mechanical_mode_is_mechanical(rng, plant):
    model = plant(rng, 1, 2, 2, True)
    turn = 0.3 * np.eye(2) + 1e-4 * model.block(0)
    into = turn @ np.array([model.b_direct[0], model.b[0]])
    out = np.linalg.solve(turn.T, np.array([model.c[:, 0], model.c_rate[:, 0]]))
    turned = model.with_(b_direct=into[:1], b=into[1:], c=out[0][:, None], c_rate=out[1][:, None])
    back = canonical(turned)
    assert np.max(np.abs(back.b_direct)) * model.omega_rad_s[0] < 1e-12
    assert np.max(np.abs(back.c_rate)) * model.omega_rad_s[0] < 1e-10 * np.max(np.abs(back.c))


def test_balanced_truncation_meets_its_error_bound(rng, plant):
    model = plant(rng, 5, 2, 2, True)
    a, b, c, d = model.state_space()
    small_a, small_b, small_c, hankel = balanced_truncation(a, b, c, 6, 0.0)
    f = np.geomspace(5.0, 5000.0, 2000)
    error = _response(control.ss(a, b, c, d), f) - _response(control.ss(small_a, small_b, small_c, d), f)
    # Enns and Glover: the H-infinity error is at most twice the sum of the neglected Hankel singular values
    assert np.max(np.linalg.norm(error, 2, axis=(1, 2))) <= 2.0 * hankel[6:].sum() * (1.0 + 1e-9)


def test_balanced_truncation_keeps_a_rigid_body():
    rigid = ModalModel(
        np.array([0.0, 300.0]), np.array([0.0, 3.0]), np.ones((2, 1)), np.zeros((2, 1)),
        np.ones((1, 2)), np.zeros((1, 2)), np.zeros((1, 1)), np.zeros(1),
    )  # fmt: skip
    a, b, c, _ = rigid.state_space()
    small_a, small_b, small_c, _ = balanced_truncation(a, b, c, 4, 1.0)
    s = 20j
    got = (small_c @ np.linalg.solve(s * np.eye(4) - small_a, small_b))[0, 0]
    assert got == pytest.approx(1.0 / s**2 + 1.0 / (s**2 + 6.0 * s + 9e4), rel=1e-8)
