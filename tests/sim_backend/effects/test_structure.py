"""Effects of the structure against closed forms, solve_ivp and python-control."""

import control
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_backend.effects import make_effect
from sim_backend.errors import ConfigError
from sim_backend.linear import ModalModel
from tests.sim_backend.effects.along import along
from tests.sim_backend.test_kernel import (
    INERTIA_KGM2,
    OMEGA,
    RATE_HZ,
    SIGMA,
    STIFFNESS_NM_RAD,
    held_torque,
    one_axis,
    play,
)

F_HZ = np.geomspace(0.1, 2000, 60)
S = 2j * np.pi * F_HZ


def two_modes(omega=OMEGA, sigma=SIGMA):
    """A dominant mode and a high one: 1/J / (s² + 2σs + ω²) + 5000 / (s² + 60 s + 800²).

    The high one has the larger residue (1/J is 3096), the dominant one the larger gain at DC.
    """
    return ModalModel(
        omega_rad_s=np.array([800.0, omega]),
        sigma_1_s=np.array([30.0, sigma]),
        b=np.array([[5000.0], [1 / INERTIA_KGM2]]),
        b_direct=np.zeros((2, 1)),
        c=np.ones((1, 2)),
        c_rate=np.zeros((1, 2)),
        d=np.zeros((1, 1)),
        delay_s=np.zeros(1),
    )


def response(effect, model):
    return effect.retune(model, 0, 0).frequency_response(F_HZ)[:, 0, 0]


HIGH = 5000 / (S**2 + 60 * S + 800.0**2)
DAMPER = 2 * SIGMA * INERTIA_KGM2


@pytest.mark.parametrize(
    ("slug", "stiffness", "damper", "inertia"),
    [("stiffness-shift", 1.03, 1, 1), ("damping-shift", 1, 1.03, 1), ("inertia-shift", 1, 1, 1.03)],
)
def test_shifts_change_their_own_constant_of_the_equation_of_motion(slug, stiffness, damper, inertia):
    k, d, j = STIFFNESS_NM_RAD * stiffness, DAMPER * damper, INERTIA_KGM2 * inertia
    got = response(make_effect(slug, "theta_x", {"relative": 0.03}), two_modes())
    np.testing.assert_allclose(got, 1 / (j * S**2 + d * S + k) + HIGH, rtol=1e-12)


def test_inertia_shift_keeps_the_numerator_of_a_block_with_direct_input():
    model = two_modes().with_(b_direct=np.array([[0.0], [7.0]]), c_rate=np.array([[0.0, 1e-3]]))
    # c q + c_rate v with q = ((s + 2σ) b_d + b) / n and v = (s b - ω² b_d) / n: the block's numerator, kept
    b = 1 / INERTIA_KGM2
    numerator = (S + 2 * SIGMA) * 7.0 + b + 1e-3 * (S * b - OMEGA**2 * 7.0)
    plain = model.frequency_response(F_HZ)[:, 0, 0] - HIGH
    np.testing.assert_allclose(plain, numerator / (S**2 + 2 * SIGMA * S + OMEGA**2), rtol=1e-9)
    got = response(make_effect("inertia-shift", "theta_x", {"relative": 0.2}), model.with_(c_rate=np.zeros((1, 2))))
    expected = ((S + 2 * SIGMA) * 7.0 + b) / (1.2 * S**2 + 2 * SIGMA * S + OMEGA**2)
    np.testing.assert_allclose(got - HIGH, expected, rtol=1e-9)


def test_a_rigid_body_is_the_dominant_mode():
    got = response(make_effect("inertia-shift", "theta_x", {"relative": 0.5}), two_modes(omega=0.0, sigma=0.0))
    np.testing.assert_allclose(got, 1 / (1.5 * INERTIA_KGM2 * S**2) + HIGH, rtol=1e-12)


def test_a_shift_where_no_mode_leads_is_refused():
    nothing = two_modes().with_(c=np.zeros((1, 2)))
    with pytest.raises(ConfigError, match="no mode leads from input 1 to output 1"):
        make_effect("stiffness-shift", "theta_x", {"relative": 0.1}).retune(nothing, 0, 0)


def test_extra_resonance_equals_python_control_in_parallel():
    share, zeta, omega = -0.3, 0.01, 2 * np.pi * 122.0
    first = control.tf([1 / INERTIA_KGM2], [1, 2 * SIGMA, OMEGA**2])
    second = control.tf([share / INERTIA_KGM2], [1, 2 * zeta * omega, omega**2])
    expected = control.parallel(first, second, control.tf([5000.0], [1, 60, 800.0**2]))(S)
    effect = make_effect(
        "extra-resonance", "theta_x", {"participation": share, "frequency_hz": 122.0, "damping_ratio": zeta}
    )
    np.testing.assert_allclose(response(effect, two_modes()), expected, rtol=1e-9)


def test_extra_resonance_as_a_series_factor_has_the_printed_zeros():
    # Table 6.2 as a product of modes: a pole pair at 123.25 Hz beside a zero pair at 122.9 Hz is a small parallel mode;
    # the partial fractions of the product, by hand, give its participation
    zero, pole = 2 * np.pi * 122.9, 2 * np.pi * 123.25
    product = control.tf([1, 0, zero**2], [1, 0, pole**2]) * control.tf([pole**2 / zero**2], [1, 0, OMEGA**2])
    scale = pole**2 / zero**2 * (zero**2 - OMEGA**2) / (pole**2 - OMEGA**2)
    share = pole**2 / zero**2 * (zero**2 - pole**2) / (OMEGA**2 - pole**2) / scale
    plant = two_modes(sigma=0.0).with_(b=np.array([[0.0], [scale]]))
    effect = make_effect(
        "extra-resonance", "theta_x", {"participation": share, "frequency_hz": 123.25, "damping_ratio": 1e-6}
    )
    # the least damping ratio the effect allows shifts the response by 2 · 1e-6 · f f0 / (f0² - f²) < 1e-3 off resonance
    np.testing.assert_allclose(response(effect, plant), product(S), rtol=1e-3)


def test_extra_resonance_rings_on_the_bench_as_solve_ivp_says():
    share, zeta, omega = 0.2, 0.02, 2 * np.pi * 125.0
    torque = held_torque(400)
    got = play(
        one_axis([("extra-resonance", {"participation": share, "frequency_hz": 125.0, "damping_ratio": zeta})]), torque
    )["theta_x"]
    states, y = [], np.zeros(4)
    for u in torque:
        states.append(y)
        y = solve_ivp(
            lambda _, x, u=u: [
                x[1],
                u / INERTIA_KGM2 - OMEGA**2 * x[0] - 2 * SIGMA * x[1],
                x[3],
                share * u / INERTIA_KGM2 - omega**2 * x[2] - 2 * zeta * omega * x[3],
            ],
            (0, 1 / RATE_HZ),
            y,
            method="DOP853",
            rtol=1e-11,
            atol=1e-15,
        ).y[:, -1]
    expected = np.array(states)[:, 0] + np.array(states)[:, 2]
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-8 * np.max(np.abs(expected)))


def test_creep_after_a_step_is_the_standard_linear_solid():
    # quasi-static spring k with creep: (k - g z) relaxes from T/k to T/(k - g), with rate (1 - g/k)/tau
    g, tau, torque_nm, inertia = 1.5, 0.05, 0.03, INERTIA_KGM2
    k = inertia * (2 * np.pi * 300.0) ** 2
    model = one_axis([("viscoelastic-creep", {"stiffness": g, "time_constant_s": tau})], sigma=1e4, frequency_hz=300.0)
    got = play(model, np.full(4000, torque_nm))["theta_x"]
    states = solve_ivp(
        lambda _, x: [x[1], (torque_nm + g * x[2]) / inertia - k / inertia * x[0] - 2e4 * x[1], (x[0] - x[2]) / tau],
        (0, 0.4),
        np.zeros(3),
        method="Radau",
        rtol=1e-9,
        atol=1e-14,
        t_eval=np.arange(4000) / RATE_HZ,
    ).y[0]
    # the relaxing torque is held and extrapolated over samples: an error of (dt / shortest time)² of its own share; the
    # slow pole of the mode decays within 1/178 s
    np.testing.assert_allclose(got, states, rtol=0, atol=g / k * (178 / RATE_HZ) * np.max(states))
    assert got[-1] == pytest.approx(torque_nm / (k - g), rel=1e-3)


def test_creep_alone_is_an_exponential():
    effect = make_effect("viscoelastic-creep", "theta_x", {"stiffness": 2.0, "time_constant_s": 0.01})
    t = np.arange(500) * 1e-4
    np.testing.assert_allclose(along(effect, position=np.ones(500)), 2 * (1 - np.exp(-t / 0.01)), rtol=0, atol=1e-13)


def test_end_stop_by_hand():
    effect = make_effect("end-stop-contact", "theta_x", {"stiffness": 100.0, "damping": 3e3, "gap": 0.01})
    x = np.array([0.0, 0.0099, 0.01, 0.012, 0.012, -0.013])
    v = np.array([9.0, 9.0, 9.0, 0.0, 0.5, -0.5])
    expected = [0, 0, 0, -0.2, -0.2 - 3e3 * 0.002 * 0.5, 0.3 + 3e3 * 0.003 * 0.5]
    np.testing.assert_allclose(along(effect, position=x, rate=v), expected, rtol=0, atol=1e-15)


def test_end_stop_holds_the_bench_where_statics_say():
    gap, stop = 5e-3, 1000.0
    model = one_axis([("end-stop-contact", {"stiffness": stop, "damping": 1e5, "gap": gap})], sigma=60.0)
    theta = play(model, np.full(4000, 0.1), substeps=4)["theta_x"]
    # k x + stop (x - gap) = T
    assert theta[-1] == pytest.approx((0.1 + stop * gap) / (STIFFNESS_NM_RAD + stop), rel=1e-6)
    assert np.max(theta) < 1.1 * gap < 0.1 / STIFFNESS_NM_RAD


def test_end_stop_only_takes_energy():
    effect = make_effect("end-stop-contact", "theta_x", {"stiffness": 100.0, "damping": 2e3, "gap": 0.01})
    t = np.linspace(0, 2 * np.pi, 20_001)
    x, v = 0.013 * np.sin(t), 0.013 * np.cos(t)
    work = np.trapezoid(along(effect, position=x, rate=v) * v, t)
    # the spring gives back what it takes; the damper takes ∮ damping · depth · rate² dt (rate per unit of t)
    depth = np.maximum(np.abs(x) - 0.01, 0)
    assert work == pytest.approx(-np.trapezoid(2e3 * depth * v**2, t), rel=1e-9)


def test_free_play_holds_nothing_within_the_gap_and_stores_no_energy():
    effect = make_effect("backlash", "theta_x", {"stiffness": STIFFNESS_NM_RAD, "gap": 1e-3})
    x = 3e-3 * np.sin(np.linspace(0, 2 * np.pi, 4001))
    torque = along(effect, position=x)
    spring = -STIFFNESS_NM_RAD * x + torque
    expected = -STIFFNESS_NM_RAD * np.sign(x) * np.maximum(np.abs(x) - 1e-3, 0)
    np.testing.assert_allclose(spring, expected, rtol=0, atol=1e-16)
    assert abs(np.trapezoid(torque, x)) < 1e-12


def test_periodic_torque_repeats_and_holds_at_its_valleys():
    effect = make_effect("periodic-torque", "theta_x", {"cosine": 2e-3, "sine": -1e-3, "period": 4e-4})
    x = np.linspace(-1e-3, 1e-3, 101)
    torque = along(effect, position=x)
    expected = np.hypot(2e-3, 1e-3) * np.cos(2 * np.pi * x / 4e-4 + np.arctan2(1e-3, 2e-3))
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-17)
    np.testing.assert_allclose(torque, along(effect, position=x + 4e-4), rtol=0, atol=1e-16)


def test_cross_coupling_adds_the_source_command():
    effect = make_effect("cross-coupling", "theta_y->theta_x", {"gain": -0.02})
    source = np.array([0.0, 0.1, -0.3])
    np.testing.assert_array_equal(along(effect, aux=source, signal=np.ones(3)), -0.02 * source)


def test_magnetic_polynomial_is_the_printed_one():
    printed = [7.289990e-9, 2.101289e-9, -2.663815e-6, 8.192315e-6, 1.059444e-4, 1.608167e-3]  # Table 6.3, x in mrad
    si = {f"p{i + 1}": p * 10.0 ** (3 * (5 - i)) for i, p in enumerate(printed)}
    x_mrad = np.linspace(-8.5, 8.5, 35)
    torque = along(make_effect("magnetic-polynomial", "theta_x", si), position=1e-3 * x_mrad)
    np.testing.assert_allclose(torque, np.polyval(printed, x_mrad), rtol=1e-12)
