"""Loops: margins against closed forms and python-control, closed-loop poles against the characteristic polynomial."""

import control
import numpy as np
import pytest

from sim_backend.control.feedback import (
    LoopShape,
    closed_loop_poles,
    complementary_sensitivity,
    loop_margins,
    pid_forward_euler,
    sensitivity,
    theta_controller,
    z_controller,
)
from sim_backend.errors import ConfigError
from sim_backend.linear import discretise
from tests.sim_backend.paper_plants import RATE_HZ, theta_x, theta_x_printed, theta_y, z_axis

LOOPS = {
    "theta_x": (theta_x, theta_controller),
    "theta_x printed": (theta_x_printed, theta_controller),
    "theta_y": (theta_y, theta_controller),
    "theta_y after learning": (theta_y, lambda: theta_controller(1.5)),
    "z": (z_axis, z_controller),
}


def _loop(name):
    plant, controller = LOOPS[name][0](), LOOPS[name][1]()
    discrete = discretise(plant, RATE_HZ)
    return lambda f: discrete.frequency_response(f)[:, 0, 0] * controller.frequency_response(f)


def test_margins_in_closed_form():
    """L = k/(s (1 + s)²): the phase is -180 degrees at 1 rad/s, where |L| = k/2."""
    k = 0.4

    def loop(f):
        s = 2j * np.pi * np.asarray(f)
        return k / (s * (1 + s) ** 2)

    margins = loop_margins(loop, 1e-4, 10.0)
    assert np.isclose(margins.gain_margin_db, 20 * np.log10(2 / k), atol=1e-6)
    assert np.isclose(2 * np.pi * margins.gain_margin_hz, 1.0, rtol=1e-9)
    # crossover w (1 + w²) = k is a cubic
    w = np.roots([1, 0, 1, -k])
    w = w[np.abs(w.imag) < 1e-12].real[0]
    assert np.isclose(2 * np.pi * margins.crossover_hz, w, rtol=1e-9)
    assert np.isclose(margins.phase_margin_deg, 90 - 2 * np.rad2deg(np.arctan(w)), atol=1e-6)


@pytest.mark.parametrize("name", LOOPS)
def test_margins_agree_with_python_control(name):
    loop = _loop(name)
    f = np.geomspace(1.0, 4999.0, 8_000)
    gain, phase, _, gain_w, phase_w, _ = control.stability_margins(control.FRD(loop(f), 2 * np.pi * f, smooth=True))
    ours = loop_margins(loop, 1.0, 4999.0)
    # the reference interpolates a table with steps of 1e-3 by splines
    assert np.isclose(ours.gain_margin_db, 20 * np.log10(gain), atol=0.01)
    assert np.isclose(ours.gain_margin_hz, gain_w / 2 / np.pi, rtol=1e-3)
    assert np.isclose(ours.phase_margin_deg, phase, atol=0.05)
    assert np.isclose(ours.crossover_hz, phase_w / 2 / np.pi, rtol=1e-3)
    peaks = np.abs(sensitivity(loop(f))).max(), np.abs(complementary_sensitivity(loop(f))).max()
    assert np.isclose(ours.sensitivity_peak_db, 20 * np.log10(peaks[0]), atol=0.01)
    assert np.isclose(ours.complementary_peak_db, 20 * np.log10(peaks[1]), atol=0.01)


@pytest.mark.parametrize("name", LOOPS)
def test_closed_loop_poles_agree_with_python_control(name):
    plant, controller = LOOPS[name][0](), LOOPS[name][1]()
    discrete = discretise(plant, RATE_HZ)
    m = plant.n_blocks
    a = np.zeros((2 * m, 2 * m))
    for i in range(m):
        a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = discrete.a[i]
    p = control.ss(a, discrete.b.reshape(-1, 1), discrete.c.reshape(1, -1), 0, 1 / RATE_HZ)
    c = control.ss(*controller.state_space(), 1 / RATE_HZ)
    reference = np.sort_complex(control.feedback(p * c, 1).poles())
    ours = np.sort_complex(closed_loop_poles(discrete, controller))
    # the reference carries no unused states, and both lose digits on poles near z = 1
    assert np.all(np.min(np.abs(ours[:, None] - reference[None, :]), axis=1)[np.abs(ours) > 1e-6] < 1e-6)
    assert np.abs(ours).max() < 1.0


def test_gain_margin_is_where_the_closed_loop_turns_unstable():
    plant = discretise(theta_x(), RATE_HZ)
    margin = 10 ** (loop_margins(_loop("theta_x"), 1.0, 4999.0).gain_margin_db / 20)
    assert np.abs(closed_loop_poles(plant, theta_controller(0.999 * margin))).max() < 1.0
    assert np.abs(closed_loop_poles(plant, theta_controller(1.001 * margin))).max() > 1.0


@pytest.mark.parametrize("delay", [1, 3])
def test_delay_enters_the_closed_loop_poles(delay):
    """A pole stays a root of 1 + L when L carries z^-delay."""
    plant = theta_y().with_(delay_s=np.array([delay / RATE_HZ]))
    discrete, controller = discretise(plant, RATE_HZ), theta_controller()
    poles = closed_loop_poles(discrete, controller)
    assert poles.size == 2 * plant.n_blocks + delay + 2 * controller.n_blocks
    slow = poles[np.argmax(np.where(poles.imag > 1e-3, np.abs(poles), 0))]
    p = sum(
        discrete.c[0, i] @ np.linalg.solve(slow * np.eye(2) - discrete.a[i], discrete.b[i, :, 0])
        for i in range(plant.n_blocks)
    )
    c = sum(
        controller.c[i] @ np.linalg.solve(slow * np.eye(2) - controller.a[i], controller.b[i])
        for i in range(controller.n_blocks)
    )
    # the pole is good to about 1e-10; near it 1 + L has a slope of up to 1e4
    assert abs(1 + p * slow**-delay * (c + controller.d)) < 1e-5


def test_pid_equals_its_textbook_form():
    kp, ki, kd, n = 89.0, 1000.0, 0.56, 4012.6
    f = np.geomspace(1.0, 4999.0, 100)
    s = RATE_HZ * (np.exp(2j * np.pi * f / RATE_HZ) - 1)
    reference = kp + ki / s + kd * n * s / (s + n)
    assert np.allclose(pid_forward_euler(kp, ki, kd, n, RATE_HZ).frequency_response(f), reference, rtol=1e-11)


def test_what_cannot_be_is_refused():
    with pytest.raises(ConfigError, match="derivative filter"):
        pid_forward_euler(1.0, 1.0, 1.0, 2.0 * RATE_HZ, RATE_HZ)
    with pytest.raises(ConfigError, match="low_pass_hz"):
        LoopShape(low_pass_hz=0.0)
    with pytest.raises(ConfigError, match="range is empty"):
        loop_margins(lambda f: f.astype(complex), 10.0, 1.0)
    with pytest.raises(ConfigError, match="one rate"):
        closed_loop_poles(discretise(theta_y(), 5000.0), theta_controller())


def test_a_part_of_a_sample_of_delay_moves_the_poles_to_where_the_loop_has_none():
    half = discretise(theta_y().with_(delay_s=np.array([0.5 / RATE_HZ])), RATE_HZ)
    controller = theta_controller()
    poles = closed_loop_poles(half, controller)
    a, b, c, d = controller.state_space()
    for z in poles[np.abs(poles) > 0.3]:  # the others are those of the register, nearly repeated at zero
        blocks = zip(half.a, half.b[:, :, 0], half.c[0], strict=True)
        plant = sum(seen @ np.linalg.solve(z * np.eye(2) - turn, driven) for turn, driven, seen in blocks)
        # the cubic through the inputs at 0, 1, 2 and 3 samples ago, read half a sample ago: Lagrange's weights
        late = (5.0 + 15.0 / z - 5.0 / z**2 + 1.0 / z**3) / 16.0
        loop = plant * late * ((c @ np.linalg.solve(z * np.eye(a.shape[0]) - a, b))[0, 0] + d[0, 0])
        assert abs(1.0 + loop) < 1e-6
