"""Discrete filters as blocks, against python-control and scipy."""

import control
import numpy as np
import pytest
from scipy import signal

from sim_backend.control.blocks import (
    DiscreteFilter,
    filter_from_state_space,
    filter_from_tf,
    filter_from_zpk,
    tustin_zpk,
)
from sim_backend.errors import ConfigError

RATE_HZ = 10_000.0
F = np.geomspace(0.1, 4999.0, 300)
Z = np.exp(2j * np.pi * F / RATE_HZ)
CASES: dict[str, tuple[list[complex], list[complex], float]] = {
    "integrator, pair, double": ([-1, 0.96, 0.98 + 0.01j, 0.98 - 0.01j], [1, 0.85, 0.73, 0.73], 172.0),
    "complex pairs": ([0.5], [0.9 + 0.3j, 0.9 - 0.3j, 0.7 + 0.1j, 0.7 - 0.1j], 2.0),
    "one real pole": ([], [0.4], -3.0),
    "near double": ([0.1], [0.8, 0.8 + 1e-9], 1.0),
    "pure gain": ([], [], 2.5),
}


@pytest.mark.parametrize("case", CASES)
def test_frequency_response_equals_the_product_form(case):
    zeros, poles, gain = CASES[case]
    ours = filter_from_zpk(zeros, poles, gain, RATE_HZ).frequency_response(F)
    product = gain * np.prod([Z - z for z in zeros] or [np.ones(1)], axis=0)
    product = product / np.prod([Z - p for p in poles] or [np.ones(1)], axis=0)
    # partial fractions of poles a tenth apart lose about four digits of sixteen
    assert np.max(np.abs(ours / product - 1)) < 1e-9


@pytest.mark.parametrize("case", CASES)
def test_state_space_equals_python_control(case):
    zeros, poles, gain = CASES[case]
    a, b, c, d = filter_from_zpk(zeros, poles, gain, RATE_HZ).state_space()
    reference = control.zpk(zeros, poles, gain, dt=1 / RATE_HZ)(Z)
    ours = control.ss(a, b, c, d, 1 / RATE_HZ)(Z) if a.size else np.full(Z.shape, d[0, 0])
    assert np.max(np.abs(ours / reference - 1)) < 1e-9


def _run(f: DiscreteFilter, u, state=None):
    x = np.zeros((f.n_blocks, 2)) if state is None else state
    out = np.empty(u.size)
    for k, value in enumerate(u):
        out[k] = np.sum(f.c * x) + f.d * value
        x = np.einsum("mij,mj->mi", f.a, x) + f.b * value
    return out, x


def test_recursion_equals_lfilter():
    b, a = signal.butter(5, 0.1)
    u = np.random.default_rng(2).normal(size=500)
    # a Butterworth filter of order 5 at a tenth of the Nyquist rate has partial fractions up to about 1e2
    assert np.allclose(_run(filter_from_tf(b, a, RATE_HZ), u)[0], signal.lfilter(b, a, u), atol=1e-9)


def test_integrator_state_is_its_share_of_the_output():
    f = filter_from_zpk(*CASES["integrator, pair, double"], RATE_HZ).scaled(1.5)
    assert f.integrator == 0
    state = np.zeros((f.n_blocks, 2))
    state[f.integrator, 0] = 0.0948
    out, after = _run(f, np.zeros(20), state)
    assert np.array_equal(out, np.full(20, 0.0948))
    assert after[0, 0] == 0.0948


def test_scaling_scales_the_response_and_keeps_the_integrators_unit():
    f = filter_from_zpk(*CASES["integrator, pair, double"], RATE_HZ)
    assert np.allclose(f.scaled(1.5).frequency_response(F), 1.5 * f.frequency_response(F), rtol=1e-13)


def test_tustin_equals_scipy():
    zeros, poles, gain = np.array([-10.0, -300.0]), np.array([-50 + 900j, -50 - 900j, -2000.0]), 7.0
    ours = tustin_zpk(zeros, poles, gain, RATE_HZ)
    reference = signal.bilinear_zpk(zeros, poles, gain, RATE_HZ)
    assert np.allclose(np.sort_complex(ours[0]), np.sort_complex(reference[0]), rtol=1e-13)
    assert np.allclose(np.sort_complex(ours[1]), np.sort_complex(reference[1]), rtol=1e-13)
    assert np.isclose(ours[2], reference[2], rtol=1e-12)


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: filter_from_zpk([0.1, 0.2], [0.5], 1.0, RATE_HZ), "future"),
        (lambda: filter_from_zpk([], [1.0, 1.0], 1.0, RATE_HZ), "one integrator"),
        (lambda: filter_from_zpk([], [0.5], 1.0, 0.0), "rate"),
        (lambda: filter_from_zpk([], [0.5], np.inf, RATE_HZ), "finite"),
        (lambda: tustin_zpk([-1.0, -2.0], [-1.0], 1.0, RATE_HZ), "low pass"),
        (lambda: DiscreteFilter(np.zeros((1, 2, 2)), np.zeros((1, 2)), np.zeros((2, 2)), 0.0, 1.0), "shape"),
        (
            lambda: DiscreteFilter(np.zeros((1, 2, 2)), np.zeros((1, 2)), np.zeros((1, 2)), 0.0, 1.0, 0),
            "not an integrator",
        ),
    ],
)
def test_what_cannot_be_is_refused(call, word):
    with pytest.raises(ConfigError, match=word):
        call()


def test_state_space_becomes_blocks_with_the_same_response():
    rng = np.random.default_rng(7)
    poles = [1.0, 0.9, 0.7 + 0.2j, 0.7 - 0.2j]
    a = control.ss(control.zpk([0.3], poles, 2.0, dt=1 / RATE_HZ)).A
    b, c = rng.standard_normal((4, 1)), rng.standard_normal((1, 4))
    made = filter_from_state_space(a, b, c, [[0.5]], RATE_HZ)
    assert made.integrator == 0 and made.n_blocks == 3
    reference = control.ss(a, b, c, 0.5, 1 / RATE_HZ)(Z)
    # the eigenvalue at 1 of this companion matrix is off by 1e-13, and at 0.1 Hz z is 6e-5 away from it
    assert np.max(np.abs(made.frequency_response(F) / reference - 1)) < 1e-8


def test_repeated_poles_are_refused_as_blocks():
    with pytest.raises(ConfigError, match="poles repeat"):
        filter_from_state_space([[0.5, 1.0], [0.0, 0.5]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]], RATE_HZ)
