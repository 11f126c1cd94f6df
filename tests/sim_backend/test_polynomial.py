"""Polynomials taken apart into modes, against exact rational arithmetic and python-control."""

from fractions import Fraction
from typing import cast

import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backend.errors import ConfigError
from sim_backend.polynomial import modal_from_polynomial, modal_from_zpk, real_pairs, scaled_roots
from tests.sim_backend.paper_plants import THETA_X_DEN, THETA_X_NUM, theta_x_printed


def _exact(coefficients, s):
    """Value of a polynomial at s = (re, im) in exact rational arithmetic."""
    re, im = Fraction(0), Fraction(0)
    for c in coefficients:
        re, im = re * s[0] - im * s[1] + Fraction(c), re * s[1] + im * s[0]
    return re, im


def test_eighth_order_response_equals_exact_evaluation():
    frequency_hz = np.array([1.0, 29.5, 122.0, 124.0, 480.0, 490.0, 1000.0, 2000.0, 4900.0])
    response = theta_x_printed().frequency_response(frequency_hz)[:, 0, 0]
    for f, value in zip(frequency_hz, response, strict=True):
        s = (Fraction(0), Fraction(2 * np.pi * f))
        n, d = _exact(THETA_X_NUM, s), _exact(THETA_X_DEN, s)
        size = d[0] ** 2 + d[1] ** 2
        exact = complex((n[0] * d[0] + n[1] * d[1]) / size, (n[1] * d[0] - n[0] * d[1]) / size) * 1e-3
        # roots of a scaled eighth-order polynomial keep about 10 digits; a resonance of damping 0.004 costs two more
        assert abs(value / exact - 1) < 1e-8


def test_roots_are_roots():
    roots = scaled_roots(THETA_X_DEN)
    size = sum(abs(c) * np.abs(roots) ** (8 - i) for i, c in enumerate(THETA_X_DEN))
    assert np.all(np.abs(np.polyval(THETA_X_DEN, roots)) < 1e-12 * size)


@given(
    st.lists(st.tuples(st.floats(1.0, 3.0), st.floats(0.001, 3.0)), min_size=1, max_size=4),
    st.floats(0.1, 10.0),
)
def test_any_sum_of_modes_agrees_with_python_control(modes, gain):
    # distinct by construction: the i-th frequency lies in its own decade
    omega = np.array([10.0**i * w for i, (w, _) in enumerate(modes)])
    zeta = np.array([z for _, z in modes])
    poles = np.concatenate([np.roots([1, 2 * z * w, w * w]) for w, z in zip(omega, zeta, strict=True)])
    # skip nearly equal real poles of different modes: their partial fractions cancel
    gaps = np.abs(poles[:, None] - poles[None, :]) + np.diag(np.full(poles.size, np.inf))
    if np.min(gaps / np.abs(poles)) < 1e-3:
        return
    frequency_hz = np.geomspace(0.1, 1000, 50)
    reference = control.zpk([], poles, gain)(2j * np.pi * frequency_hz)
    ours = modal_from_zpk([], poles, gain).frequency_response(frequency_hz)[:, 0, 0]
    # absolute: far above the modes the terms of the sum cancel
    assert np.allclose(ours, reference, rtol=1e-6, atol=1e-9 * np.max(np.abs(reference)))


def test_double_real_pole_and_direct_term():
    model = modal_from_polynomial([2.0, 3.0, 5.0], [1.0, 20.0, 100.0])
    f = np.array([0.0, 1.0, 10.0])
    s = 2j * np.pi * f
    assert np.allclose(model.frequency_response(f)[:, 0, 0], (2 * s**2 + 3 * s + 5) / (s + 10) ** 2, rtol=1e-12)


def test_a_double_root_stays_in_one_pair():
    pairs = cast(list[tuple[complex, complex]], real_pairs([-1.0, -2.0, -2.0, -5.0]))
    assert sorted(sorted((p.real, q.real)) for p, q in pairs) == [[-5.0, -1.0], [-2.0, -2.0]]


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: scaled_roots([0.0, 1.0]), "leading coefficient"),
        (lambda: modal_from_zpk([-1, -2, -3], [-1, -2], 1.0), "improper"),
        (lambda: modal_from_zpk([], [-1, -2, -3], 1.0), "even number"),
        (lambda: modal_from_zpk([], [-1 + 1j, -2], 1.0), "conjugate"),
        (lambda: modal_from_zpk([], [-1, -1, -1, -1], 1.0), "two second-order blocks"),
    ],
)
def test_what_cannot_be_is_refused(call, word):
    with pytest.raises(ConfigError, match=word):
        call()
