"""The hidden bench against closed forms and against solve_ivp with its own written equations."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete, dlsim

from analysis.challenge.bench import exact_step, move
from analysis.challenge.families.drive import CoilHeating, Delay, ForceConstant, Lag
from analysis.challenge.families.hysteresis import BoucWen
from analysis.challenge.families.structure import Cogging, Creep, CubicStiffness, EndStop, Friction, Play
from analysis.challenge.families.surroundings import ThermalStiffness
from analysis.challenge.motion import Excitation
from analysis.challenge.plant import Plant

RATE_HZ = 4000.0
OMEGA, SIGMA, INERTIA = 2.0 * np.pi * 25.0, 6.0, 3e-4
STIFFNESS = INERTIA * OMEGA**2
PLANT = Plant(np.array([OMEGA]), np.array([SIGMA]), np.array([[1.0 / INERTIA]]), np.array([[1.0]]), np.zeros(1))
REST = np.zeros((1, 2))
SWING = 4e-3
PERIOD_S = 0.1


def excitation(n: int = 800, substeps: int = 8, kelvin: float = 0.0) -> Excitation:
    time = np.arange(n) / RATE_HZ
    command = STIFFNESS * SWING * np.sin(2.0 * np.pi * time / PERIOD_S)
    return Excitation(command[:, None], np.full(n, 77.0 + kelvin), RATE_HZ, 77.0, substeps)


def reference(played: Excitation, torque, states: int = 0, slope=None) -> np.ndarray:
    """Return the position at every sample by solve_ivp, restarted at each step of the held command."""
    x, out = np.zeros(2 + states), np.empty(played.n)
    for k, u in enumerate(played.command[:, 0]):
        out[k] = x[0]

        def rhs(_t: float, s: np.ndarray, u: float = u) -> list[float]:
            force = u + torque(s, u)
            more = slope(s) if slope else []
            return [s[1], force / INERTIA - 2.0 * SIGMA * s[1] - OMEGA**2 * s[0], *more]

        x = solve_ivp(rhs, (0.0, 1.0 / RATE_HZ), x, method="DOP853", rtol=1e-10, atol=1e-13).y[:, -1]
    return out


def test_linear_motion_is_that_of_the_exact_hold_equivalent() -> None:
    played = excitation()
    a = np.array([[0.0, 1.0], [-(OMEGA**2), -2.0 * SIGMA]])
    system = cont2discrete((a, np.array([[0.0], [1.0 / INERTIA]]), np.array([[1.0, 0.0]]), 0.0), 1.0 / RATE_HZ)
    _, expected, _ = dlsim(system, played.command)
    found = move(PLANT, (), played, REST, np.random.default_rng(0)).sampled()
    # both are exact, so they differ by rounding alone
    assert found[:, 0] == pytest.approx(expected[:, 0], abs=1e-12 * SWING * played.n)


def test_exact_step_of_an_undamped_mode_is_a_rotation() -> None:
    plant = replace(PLANT, sigma_1_s=np.zeros(1))
    step, push = exact_step(plant, 1e-3)
    angle = OMEGA * 1e-3
    rotation = [[math.cos(angle), math.sin(angle) / OMEGA], [-OMEGA * math.sin(angle), math.cos(angle)]]
    assert step[0] == pytest.approx(np.array(rotation), rel=1e-12)
    assert push[0] == pytest.approx([(1.0 - math.cos(angle)) / OMEGA**2, math.sin(angle) / OMEGA], rel=1e-10)


# each law in equations of this file: effect, torque(state, command), number of further states, their slopes
BEND = 0.5 * STIFFNESS / SWING**2
LAWS = {
    "cubic": (CubicStiffness(0, BEND / 4, 1.0), lambda s, u: -BEND / 4 * s[0] ** 3, 0, None),
    "cogging": (
        Cogging(0, 0.02 * STIFFNESS * SWING, SWING, 0.4),
        lambda s, u: 0.02 * STIFFNESS * SWING * math.sin(2 * math.pi * s[0] / SWING + 0.4),
        0,
        None,
    ),
    "force constant": (
        ForceConstant(0, 0.2, math.atan2(0.6, 0.8), SWING),
        lambda s, u: u * (0.16 * s[0] / SWING + 0.12 * (s[0] / SWING) ** 2),
        0,
        None,
    ),
    "end stop": (
        EndStop(0, 0.5 * STIFFNESS, 0.7 * SWING, 0.3),
        lambda s, u: -max(abs(s[0]) - 0.7 * SWING, 0.0) * 0.5 * STIFFNESS * (math.copysign(1.0, s[0]) + 0.3 * s[1]),
        0,
        None,
    ),
    "play": (
        Play(0, 0.2 * STIFFNESS, 0.1 * SWING),
        lambda s, u: 0.2 * STIFFNESS * min(max(s[0], -0.1 * SWING), 0.1 * SWING),
        0,
        None,
    ),
    "creep": (
        Creep(0, 0.2 * STIFFNESS, 0.02),
        lambda s, u: 0.2 * STIFFNESS * s[2],
        1,
        lambda s: [(s[0] - s[2]) / 0.02],
    ),
    "Bouc-Wen": (
        BoucWen(0, 0.2 * STIFFNESS, 0.3 * SWING, 0.6),
        lambda s, u: -0.2 * STIFFNESS * s[2],
        1,
        lambda s: [s[1] - 0.6 / (0.3 * SWING) * abs(s[1]) * s[2] - 0.4 / (0.3 * SWING) * s[1] * abs(s[2])],
    ),
    "LuGre": (
        Friction(0, 0.05 * STIFFNESS * SWING, 0.05 * SWING, 1.0, 1.0),
        lambda s, u: -STIFFNESS * s[2],
        1,
        lambda s: [s[1] - STIFFNESS * abs(s[1]) / (0.05 * STIFFNESS * SWING) * s[2]],
    ),
}


@pytest.mark.parametrize("law", LAWS)
def test_law_follows_its_equations(law: str) -> None:
    effect, torque, states, slope = LAWS[law]
    played = excitation(400)
    expected = reference(played, torque, states, slope)
    plain = move(PLANT, (), played, REST, np.random.default_rng(0)).sampled()[:, 0]
    found = move(PLANT, (effect,), played, REST, np.random.default_rng(0)).sampled()[:, 0]
    acted = float(np.max(np.abs(expected - plain)))
    # second order in the fine step: (omega dt)² at the law's fastest scale, here 0.003² for smooth laws and below 1e-3
    # for laws with a corner, which a step of dt passes in the middle
    assert acted > 0.01 * SWING
    assert float(np.max(np.abs(found - expected))) < 1e-3 * acted


def test_fine_steps_converge_with_second_order() -> None:
    effect = CubicStiffness(0, BEND / 4, 1.0)
    expected = reference(excitation(300), lambda s, u: -BEND / 4 * s[0] ** 3)
    errors = [
        float(
            np.max(
                np.abs(
                    move(PLANT, (effect,), excitation(300, n), REST, np.random.default_rng(0)).sampled()[:, 0]
                    - expected
                )
            )
        )
        for n in (1, 2, 4)
    ]
    # halving the step divides the error by four; a band of 3 to 5 leaves room for the next order
    assert all(3.0 < a / b < 5.0 for a, b in zip(errors, errors[1:], strict=False))


def test_warming_softens_the_spring_by_its_coefficient() -> None:
    effect = ThermalStiffness(0, 0.01 * STIFFNESS, -1.0)
    played = excitation(800, kelvin=5.0)
    softer = replace(PLANT, omega_rad_s=np.array([OMEGA * math.sqrt(1.0 - 0.05)]))
    found = move(PLANT, (effect,), played, REST, np.random.default_rng(0)).sampled()
    expected = move(softer, (), played, REST, np.random.default_rng(0)).sampled()
    # (omega dt)² of the fine step is 2.4e-5 of what the effect does
    assert found == pytest.approx(expected, abs=1e-4 * SWING)


def test_lag_and_delay_act_as_their_transfer_functions() -> None:
    played = excitation(4000)
    frequency_hz = 1.0 / PERIOD_S
    turn = 2j * np.pi * frequency_hz
    whole = slice(2000, 4000)  # five periods, the lag has long settled
    kernel = np.exp(-turn * np.arange(4000) / RATE_HZ)[whole]

    def gain(drive: np.ndarray) -> complex:
        return complex(np.sum(drive.reshape(-1, played.substeps).mean(axis=1)[whole] * kernel))

    drive = played.fine(played.command)
    lag = Lag(0, 2e-3).on_command(drive, played)
    # the mean over a sample of the continuous lag's output, behind the same hold as the command
    assert gain(lag[:, 0]) / gain(drive[:, 0]) == pytest.approx(1.0 / (1.0 + turn * 2e-3), rel=1e-4)
    late = move(Delay(0, 7.3 / RATE_HZ).on_plant(PLANT), (), played, REST, np.random.default_rng(0)).sampled()[:, 0]
    soon = move(PLANT, (), played, REST, np.random.default_rng(0)).sampled()[:, 0]
    # a delay of no whole number of fine steps is shared between two: (2π f dt)²/8 of the signal
    settled = slice(3600, 4000)
    kernel = np.exp(-turn * np.arange(4000) / RATE_HZ)[settled]
    ratio = np.sum(late[settled] * kernel) / np.sum(soon[settled] * kernel)
    assert ratio == pytest.approx(np.exp(-turn * 7.3 / RATE_HZ), rel=2e-3)


def test_coil_heats_towards_the_mean_square_of_a_constant_command() -> None:
    n, time_s = 2000, 0.1
    played = Excitation(np.ones((n, 1)), np.full(n, 77.0), RATE_HZ, 77.0)
    drive = CoilHeating(0, 0.2, time_s, 1.0).on_command(played.fine(played.command), played)[:, 0]
    at = np.arange(drive.size) * played.fine_s
    assert drive == pytest.approx(1.0 - 0.2 * (1.0 - np.exp(-at / time_s)), abs=1e-12)
