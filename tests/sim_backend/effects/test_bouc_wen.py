"""Bouc–Wen hysteresis against its equation, integrated independently, its limits, and a published oscillator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_backend.effects import make_effect
from sim_backend.model import EffectEntry, Mode, Model, Port
from tests.sim_backend.effects.along import along
from tests.sim_backend.test_kernel import play

CORNERS = np.array([0.0, 2.5, -1.0, 1.5, -2.5, 0.5]) * 1e-3


def bouc_wen(**parameters):
    return make_effect("bouc-wen", "theta_x", {"stiffness": 1.0, "reach": 1e-3, **parameters})


def path(n, corners=CORNERS):
    """Straight from corner to corner, `n` samples each, and the last corner."""
    lines = [np.linspace(a, b, n, endpoint=False) for a, b in zip(corners[:-1], corners[1:], strict=True)]
    return np.append(np.concatenate(lines), corners[-1])


def deflections(x, *, reach, gamma_over_beta=0.0, exponent=1.0):
    """Reference: z at every x by solve_ivp from sample to sample, in the letters of Bouc and Wen."""
    beta = reach**-exponent
    gamma, z, out = gamma_over_beta * beta, 0.0, [0.0]
    for before, after in zip(x[:-1], x[1:], strict=True):
        way = np.sign(after - before)

        def slope(_, z, way=way):
            # dz/dt = v - beta |v| |z|^(n-1) z - gamma v |z|^n, along the path: over v = ±1
            size = abs(z[0])
            return [1.0 - (beta * way * np.sign(z[0]) + gamma) * size**exponent]

        z = solve_ivp(slope, (before, after), [z], method="LSODA", rtol=1e-10, atol=1e-15).y[0, -1] if way else z
        out.append(z)
    return np.array(out)


SHAPES = {
    "dahl": {},
    "straight back": {"gamma_over_beta": 1.0},
    "bends late": {"gamma_over_beta": 0.3, "exponent": 3.0},
    "neither softens nor stiffens": {"gamma_over_beta": -1.0},
    "stiffens": {"gamma_over_beta": -1.4},
}


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
@pytest.mark.parametrize("n", [100, 3], ids=["fine", "coarse"])
def test_it_solves_its_equation(shape, n):
    x = path(n)
    expected = deflections(x, reach=1e-3, **shape)
    # in steps of a twentieth of a reach the midpoint rule errs by (1/20)²/4 = 6e-4 of a reach where z changes its sign,
    # and with it its slope, and by a tenth of that in between; there are four such places, and nothing forgets where
    # loops do not soften
    np.testing.assert_allclose(
        along(bouc_wen(**shape), position=x), -expected, rtol=0, atol=4 * 6e-4 * max(1e-3, np.max(np.abs(expected)))
    )


def test_it_converges_with_the_square_of_the_step():
    errors = []
    for n in (100, 200, 400):  # at most 0.04 reaches per sample: one step each
        x = path(n)
        shape = SHAPES["straight back"]
        errors.append(np.max(np.abs(along(bouc_wen(**shape), position=x) + deflections(x, reach=1e-3, **shape))))
    # a sixteenth, scattered as the kinks stand anywhere in a step; a rule of first order would leave a quarter
    assert errors[1] < 1e-3 * 1e-3 and errors[2] < errors[0] / 8.0


def test_without_gamma_a_branch_is_an_exponential():
    x = np.linspace(0.0, 3e-3, 3001)
    # steps of a thousandth of a reach: (1e-3)²/24 = 4e-8
    np.testing.assert_allclose(along(bouc_wen(), position=x), -1e-3 * (1 - np.exp(-x / 1e-3)), rtol=0, atol=1e-10)


@pytest.mark.parametrize(("bend", "exponent"), [(0.0, 1.0), (1.0, 1.0), (0.5, 3.0), (-0.5, 2.0)])
def test_softening_loops_end_at_the_known_level(bend, exponent):
    far = np.linspace(0.0, 40e-3, 4001)
    torque = along(bouc_wen(gamma_over_beta=bend, exponent=exponent), position=far)
    # 40 reaches bring it there to e^-20 at the slowest of these rates, exponent · (1 + bend)^(1/exponent) = 1
    assert -torque[-1] == pytest.approx(1e-3 / (1 + bend) ** (1 / exponent), rel=1e-6)


@pytest.mark.parametrize(("bend", "sign"), [(-1.4, 1.0), (-1.0, 0.0), (0.5, -1.0)])
def test_sign_of_one_plus_gamma_over_beta_tells_stiffening_from_softening(bend, sign):
    torque = -along(bouc_wen(gamma_over_beta=bend), position=np.linspace(0.0, 2e-3, 2001))
    curvature = np.diff(torque, 2)
    if sign:
        assert np.all(curvature * sign > 0.0)
    else:
        np.testing.assert_allclose(curvature, 0.0, atol=1e-15)  # a straight line, to rounding of 2e-3


def test_a_large_exponent_is_a_spring_that_slips():
    # z = x up to the reach and no further; (z/r)^8 is below a twentieth up to 0.69 reaches
    x = np.linspace(0.0, 2e-3, 2001)
    z = -along(bouc_wen(exponent=8.0), position=x)
    np.testing.assert_allclose(z[x < 0.6e-3], x[x < 0.6e-3], rtol=2e-3)  # ∫ (x/r)^8 dx = 0.6^9/9 = 1.1e-3 of r
    assert np.all(z <= 1e-3 * (1 + 1e-9)) and z[-1] == pytest.approx(1e-3, rel=1e-3)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_speed_is_not_seen(shape):
    slow, fast = along(bouc_wen(**shape), position=path(1000)), along(bouc_wen(**shape), position=path(20))
    # both solve the same equation, see above
    np.testing.assert_allclose(slow[::50], fast, rtol=0, atol=4 * 6e-4 * max(1e-3, np.max(np.abs(fast))))


@pytest.mark.parametrize("bend", [-1.0, 0.0, 1.0])
def test_it_takes_energy_from_a_cycle(bend):
    # admissible where |gamma| <= beta (Erlicher and Bursi, J. Eng. Mech. 134 (2008))
    x = 2e-3 * np.sin(2 * np.pi * np.arange(6001) / 2000)
    torque = along(bouc_wen(gamma_over_beta=bend), position=x)
    work = np.trapezoid(torque[-2001:], x[-2001:])
    assert -4 * 2e-3 * np.max(np.abs(torque)) < work < 0.0


RATE_HZ = 750.0
MASS_KG, SPRING_N_M, DAMPING_N_S_M = 2.0, 5e4, 10.0
ALPHA_N_M, BETA_1_M, GAMMA, DELTA = 5e4, 1e3, 0.8, -1.1


def test_the_oscillator_of_the_public_benchmark():
    """m y'' + c y' + k y + z = u, z' = alpha v - beta (gamma |v| z + delta v |z|): its own letters, by solve_ivp."""
    rng = np.random.default_rng(3)
    u = 60.0 * np.repeat(rng.standard_normal(150), 5)

    def slope(_, y, force):
        x, v, z = y
        return [
            v,
            (force - SPRING_N_M * x - DAMPING_N_S_M * v - z) / MASS_KG,
            ALPHA_N_M * v - BETA_1_M * (GAMMA * abs(v) * z + DELTA * v * abs(z)),
        ]

    expected, y = np.empty(u.size), np.zeros(3)
    for k, force in enumerate(u):
        expected[k] = y[0]
        y = solve_ivp(slope, (0, 1 / RATE_HZ), y, args=(force,), method="RK45", rtol=1e-8, atol=1e-13).y[:, -1]

    def bench(effects):
        return Model(
            name="oscillator",
            sample_rate_hz=RATE_HZ,
            inputs=[Port(name="torque", unit="N", dof="theta_x")],
            outputs=[Port(name="theta_x", unit="m", dof="theta_x")],
            modes=[
                Mode(
                    label="mass",
                    frequency_hz=np.sqrt(SPRING_N_M / MASS_KG) / (2 * np.pi),
                    decay_rate_1_s=DAMPING_N_S_M / (2 * MASS_KG),
                    input={"torque": 1 / MASS_KG},
                    output={"theta_x": 1.0},
                )
            ],
            effects=effects,
        )

    effect = EffectEntry(
        effect="bouc-wen",
        where="theta_x",
        parameters={"stiffness": ALPHA_N_M, "reach": 1 / (BETA_1_M * GAMMA), "gamma_over_beta": DELTA / GAMMA},
    )
    errors = []
    for substeps in (8, 16):
        x = play(bench([effect]), u, substeps=substeps)["theta_x"]
        errors.append(float(np.max(np.abs(x - expected)) / np.max(np.abs(expected))))
    # half the stiffness stands in the effect, and an angle of 0.3 per sample is 0.04 per step of eight: the loop errs
    # by 0.04²/12 per radian, over the thirty radians in which the oscillator forgets (Q = 10); less with finer steps
    assert errors[0] < 0.04**2 / 12.0 * 30.0
    assert errors[1] < 0.5 * errors[0]
    linear = play(bench([]), u, substeps=8)["theta_x"]
    assert np.max(np.abs(linear - expected)) > 0.3 * np.max(np.abs(expected))
