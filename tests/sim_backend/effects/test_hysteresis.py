"""The three hysteresis models against their equations, integrated independently, and the paper's loop."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_backend.effects import make_effect
from tests.sim_backend.effects.along import along
from tests.sim_backend.test_kernel import INERTIA_KGM2, OMEGA, RATE_HZ, SIGMA, STIFFNESS_NM_RAD, one_axis, play

PRINTED = {"size": 0.99, "a": 0.44, "c": 0.22, "alpha": 1e-3, "ms": 0.44}
"""Table 6.3 but for the pinning."""


def jiles_atherton(pinning=2.2e-3, **changes):
    return make_effect("jiles-atherton", "theta_x", {**PRINTED, "pinning": pinning, **changes})


def langevin(x):
    return x / 3 if abs(x) < 1e-5 else 1 / np.tanh(x) - 1 / x


def langevin_slope(x):
    return 1 / 3 - x**2 / 15 if abs(x) < 1e-3 else 1 - 1 / np.tanh(x) ** 2 + 1 / x**2


def magnetisation(fields, *, pinning, a, c, alpha, ms, **_):
    """Reference: (6.4) from one reversal to the next by solve_ivp; returns M at every field of `fields`.

    dM/dH is found from the equation with dM/dH on both sides, by solving the linear equation for it.
    """
    m, out = 0.0, [0.0]
    for before, after in zip(fields[:-1], fields[1:], strict=True):
        delta = np.sign(after - before)

        def slope(h, y, delta=delta):
            x = (h + alpha * y[0]) / a
            gap = ms * langevin(x) - y[0]
            irreversible = max(delta * gap, 0) * delta / ((1 + c) * (delta * pinning - alpha * gap))
            reversible = c / (1 + c) * ms / a * langevin_slope(x)
            return [(irreversible + reversible) / (1 - alpha * reversible)]

        m = solve_ivp(slope, (before, after), [m], method="LSODA", rtol=1e-10, atol=1e-14).y[0, -1]
        out.append(m)
    return np.array(out)


def sine(amplitude, n=2000, periods=3):
    return amplitude * np.sin(2 * np.pi * np.arange(periods * n + 1) / n)


@pytest.mark.parametrize(
    "parameters",
    [
        {**PRINTED, "pinning": 2.2e-3},
        # strongly bent, coupled and saturating: every term of the equation matters
        {"size": 1.0, "a": 2e-3, "pinning": 2e-3, "c": 0.5, "alpha": 1e-3, "ms": 1.0},
    ],
    ids=["printed", "saturating"],
)
@pytest.mark.parametrize("n", [2000, 40], ids=["fine", "coarse"])
def test_jiles_atherton_solves_its_equation(parameters, n):
    theta = sine(8.5e-3, n)
    torque = along(make_effect("jiles-atherton", "theta_x", parameters), position=theta)
    expected = parameters["size"] * magnetisation(theta, **parameters)
    # Heun over sub-increments of at most a twentieth of the pinning: (1/20)²/6 = 4e-4 of M, also where the samples are
    # 60 times coarser
    np.testing.assert_allclose(torque, expected, rtol=0, atol=4e-4 * np.max(np.abs(expected)))


def test_reversible_magnetisation_is_the_langevin_function():
    # the irreversible part is pinned for good, c / (1 + c) of the anhysteretic curve is left; the amplitude covers the
    # series near zero and the closed form beyond
    a, c = 0.1, 0.25
    theta = sine(0.02, 40_000, periods=1)
    torque = along(
        make_effect("jiles-atherton", "theta_x", {"size": 1.0, "a": a, "pinning": 1e9, "c": c}), position=theta
    )
    expected = c / (1 + c) * np.array([langevin(x) for x in theta / a])
    # Heun: (step / a)² / 12 = 8e-11 of M; the irreversible part adds theta / pinning
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-9 * np.max(expected))


def test_jiles_atherton_converges_with_the_square_of_the_increment():
    parameters = {"size": 1.0, "a": 5e-3, "pinning": 5e-3, "c": 0.2, "alpha": 0.0, "ms": 1.0}
    errors = []
    for n in (400, 800, 1600):  # increments below a twentieth: no sub-increments
        theta = np.linspace(0.0, 5e-3, n // 4 + 1)
        got = along(make_effect("jiles-atherton", "theta_x", parameters), position=theta)[-1]
        errors.append(abs(got - magnetisation(theta[[0, -1]], **parameters)[-1]))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(
        orders, 2.0, rtol=0, atol=0.1
    )  # the next term of Heun's error is one order smaller in 1/n


def displacement_at_zero_drive(theta, torque):
    """Quasi-static: the springs balance drive and torque. Returns the positions at which the drive crosses zero."""
    drive = STIFFNESS_NM_RAD * theta - torque
    at = np.flatnonzero(np.diff(np.sign(drive)))
    return theta[at] - drive[at] * (theta[at + 1] - theta[at]) / (drive[at + 1] - drive[at])


@pytest.mark.parametrize(("amplitude", "percent"), [(4.5e-3, 0.78), (7.2e-3, 0.74), (8.5e-3, 0.68)])
def test_pinning_gives_the_remanence_of_the_paper(amplitude, percent):
    # the paper reads "approx. 0.7 %" off Fig. 6.7; `percent` is the torque left at zero position over the stiffness.
    # The displacement at zero drive is 1/40 larger, as M itself takes 3 % of the stiffness: 0.79, 0.76 and 0.70 %.
    branch = np.concatenate([amplitude * np.array([0.0, 1, -1, 1, -1]), np.linspace(amplitude, -amplitude, 401)])
    expected = 0.99 * magnetisation(branch, **PRINTED, pinning=2.2e-3)
    theta = sine(amplitude, 20_000)
    torque = along(jiles_atherton(), position=theta)[40_000:]
    at_zero_drive = displacement_at_zero_drive(theta[40_000:], torque)
    # Heun's 4e-4 of M, with M a few times larger than its remanence
    np.testing.assert_allclose(np.abs(torque[10_000]), abs(expected[5 + 200]), rtol=2e-3)
    np.testing.assert_allclose(
        np.abs(at_zero_drive), displacement_at_zero_drive(branch[5:], expected[5:])[0], rtol=2e-3
    )
    # stated to two digits; the loop of 4.5 mrad is 0.772 % here
    assert abs(torque[10_000]) / STIFFNESS_NM_RAD / amplitude * 100 == pytest.approx(percent, abs=0.01)
    assert 0.65e-2 < np.max(np.abs(at_zero_drive)) / amplitude < 0.80e-2


def test_printed_pinning_gives_no_hysteresis_at_all():
    # k/µ0 with the printed k = 1750.7: 1.4e9, in the field's unit
    pinning = 1750.7 / (4e-7 * np.pi)
    assert pinning == pytest.approx(1.4e9, rel=0.01)
    assert 1750.7 * 4e-7 * np.pi == pytest.approx(2.2e-3, rel=1e-4)
    theta = sine(8.5e-3)
    left = displacement_at_zero_drive(theta, along(jiles_atherton(pinning), position=theta))
    assert np.max(np.abs(left)) < 1e-9 * 8.5e-3


@pytest.mark.parametrize("amplitude", [4.5e-3, 7.2e-3, 8.5e-3])
def test_jiles_atherton_takes_energy_from_the_motion(amplitude):
    theta = sine(amplitude)
    torque = along(jiles_atherton(), position=theta)
    work = np.trapezoid(torque[-2001:], theta[-2001:])
    # per period it takes between nothing and that of a rectangle as high and wide as the loop
    assert -4 * amplitude * np.max(np.abs(torque)) < work < 0


def test_jiles_atherton_adds_its_torque_to_the_drive_of_the_bench():
    # mode and magnetisation integrated as one system, dM/dt = dM/dH · rate, one solve per held sample
    n, period = 1200, 500
    torque = 0.05 * np.sin(2 * np.pi * np.arange(n) / period)
    pinning, a, c, alpha, ms = 2.2e-3, 0.44, 0.22, 1e-3, 0.44

    def slope(_, y, u):
        h, delta = y[0], np.sign(y[1])
        x = (h + alpha * y[2]) / a
        gap = ms * langevin(x) - y[2]
        irreversible = max(delta * gap, 0) * delta / ((1 + c) * (delta * pinning - alpha * gap)) if delta else 0.0
        reversible = c / (1 + c) * ms / a * langevin_slope(x)
        change = (irreversible + reversible) / (1 - alpha * reversible)
        return [y[1], (u + 0.99 * y[2]) / INERTIA_KGM2 - OMEGA**2 * h - 2 * SIGMA * y[1], change * y[1]]

    expected, y = np.empty(n), np.zeros(3)
    for k, u in enumerate(torque):
        expected[k] = y[0]
        y = solve_ivp(slope, (0, 1 / RATE_HZ), y, args=(u,), method="RK45", rtol=1e-7, atol=1e-12).y[:, -1]
    model = one_axis([("jiles-atherton", {**PRINTED, "pinning": pinning})])
    theta, linear = play(model, torque)["theta_x"], play(one_axis(), torque)["theta_x"]
    # M is 3 % of the springs' torque and within 4e-4 of its equation; the loop's own error is a tenth of that
    np.testing.assert_allclose(theta, expected, rtol=0, atol=0.03 * 4e-4 * np.max(np.abs(expected)))
    assert np.max(np.abs(linear - expected)) > 0.01 * np.max(np.abs(expected))


def test_jiles_atherton_saturates_at_ms():
    torque = along(jiles_atherton(), position=np.linspace(0, 400.0, 4000))
    assert torque[-1] == pytest.approx(0.99 * 0.44 * (1 - 0.44 / 400), rel=1e-3)


def test_scaling_ms_against_the_size_changes_nothing():
    theta = sine(8.5e-3)
    one, other = jiles_atherton(alpha=0.0), jiles_atherton(alpha=0.0, size=0.99 * 0.44, ms=1.0)
    expected = along(other, position=theta)
    # thousands of increments, each rounded to 1e-16
    np.testing.assert_allclose(along(one, position=theta), expected, rtol=0, atol=1e-13 * np.max(np.abs(expected)))


STIFFNESSES = {"stiffness_1": 0.5, "stiffness_2": 0.4, "stiffness_3": 0.3, "stiffness_4": 0.2}
LADDER = 1e-3 / 3.0 ** np.arange(4)


def maxwell():
    return make_effect("hysteresis", "theta_x", {**STIFFNESSES, "reach": 1e-3})


def virgin(x):
    """Closed form: the curve from rest, sum k_i min(x, reach_i)."""
    return sum(k * np.minimum(x, d) for k, d in zip(STIFFNESSES.values(), LADDER, strict=True))


def test_maxwell_slip_follows_the_virgin_curve():
    x = np.linspace(0, 2e-3, 500)
    np.testing.assert_allclose(along(maxwell(), position=x), -virgin(x), rtol=0, atol=1e-17)


def test_maxwell_slip_obeys_masing():
    # after a reversal at x0 the branch is the virgin curve doubled in both directions
    x0 = 1.3e-3
    down = np.linspace(x0, -x0, 400)
    torque = along(maxwell(), position=np.concatenate([np.linspace(0, x0, 200), down]))[200:]
    np.testing.assert_allclose(torque, -virgin(x0) + 2 * virgin((x0 - down) / 2), rtol=0, atol=1e-16)


def test_maxwell_slip_closes_minor_loops_and_does_not_see_the_speed():
    corners = [0.0, 1.5e-3, 0.4e-3, 0.9e-3, 0.4e-3, 1.5e-3, 0.0]

    def path(n):
        return np.concatenate(
            [np.linspace(a, b, n, endpoint=False) for a, b in zip(corners[:-1], corners[1:], strict=True)]
        )

    slow, fast = along(maxwell(), position=path(1000), rate=np.ones(6000)), along(maxwell(), position=path(10))
    np.testing.assert_allclose(slow[::100], fast, rtol=0, atol=1e-16)
    # the inner loop 0.4 → 0.9 → 0.4 ends where it began, and at 1.5 the outer one goes on
    assert slow[2000] == pytest.approx(slow[4000], abs=1e-16)
    assert slow[1000] == pytest.approx(slow[5000], abs=1e-16)


def test_maxwell_slip_takes_the_energy_of_its_sliders():
    # slider i moves by 4 (A - reach_i) per period against its k_i reach_i
    amplitude, n = 1.5e-3, 3000
    theta = amplitude * np.concatenate(
        [np.linspace(0, 1, n), np.linspace(1, -1, 2 * n)[1:], np.linspace(-1, 1, 2 * n)[1:]]
    )
    torque = along(maxwell(), position=theta)[n - 1 :]
    expected = -sum(4 * k * d * (amplitude - d) for k, d in zip(STIFFNESSES.values(), LADDER, strict=True))
    # the trapezoid misses at most half a step at each of the eight corners: 1e-3 of the largest term
    assert np.trapezoid(torque, theta[n - 1 :]) == pytest.approx(expected, rel=1e-3)


def test_drive_hysteresis_is_the_prandtl_ishlinskii_operator():
    weights = np.array([0.1, 0.08, 0.05, 0.03])
    effect = make_effect(
        "drive-hysteresis", "theta_x", {**{f"weight_{i + 1}": w for i, w in enumerate(weights)}, "reach": 0.3}
    )
    rng = np.random.default_rng(0)
    u = np.interp(np.arange(2000), np.arange(0, 2001, 50), rng.uniform(-0.5, 0.5, 41))
    # independent: play operators p_i = max(u - r, min(u + r, p_i)); u + sum w (play - u)
    out = np.zeros(2000)
    for w, r in zip(weights, 0.3 / 3.0 ** np.arange(4), strict=True):
        play = 0.0
        for k, value in enumerate(u):
            play = max(value - r, min(value + r, play))
            out[k] += w * (play - value)
    np.testing.assert_allclose(along(effect, signal=u), out, rtol=0, atol=1e-14)


def test_drive_hysteresis_gain_grows_with_the_amplitude_and_lags():
    effect = make_effect("drive-hysteresis", "theta_x", {"weight_1": 0.3, "reach": 0.1})
    first_harmonic = []
    for amplitude in (0.02, 0.2, 2.0):
        u = sine(amplitude)
        y = (u + along(effect, signal=u))[2000:4000]
        first_harmonic.append(
            2 * np.mean(y * np.exp(-1j * (2 * np.pi * np.arange(2000) / 2000 - np.pi / 2))) / amplitude
        )
    gains = np.abs(first_harmonic)
    assert gains[0] == pytest.approx(0.7, abs=1e-3)  # nothing slips: u - 0.3 u
    assert np.all(np.diff(gains) > 0.1)
    assert np.angle(first_harmonic[1]) < -0.02
