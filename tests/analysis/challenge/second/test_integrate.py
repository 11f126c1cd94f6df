"""Every law is integrated as an independent solver integrates it, and the linear plant exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from analysis.challenge.second.campaign import Campaign, draw_campaign
from analysis.challenge.second.integrate import Placed, exponentials, integrate
from analysis.challenge.second.laws import LAWS
from analysis.challenge.second.limits import placed
from analysis.challenge.second.plant import Plant

Array = NDArray[np.float64]

RATE_HZ = 1000.0
TORQUES = sorted(name for name, law in LAWS.items() if law.how == "torque")
ABRUPT = {
    "rounded-command": 1e-9,  # a step of the command is a step of its rounding
    "falling-out": 0.03,  # the contact opens within a step
    "sudden-age": 0.03,
    "loose-mass": 0.05,  # a knock begins within a step
    "flag-loop": 0.03,
    "presliding": 0.03,
    "smooth-coulomb": 0.02,  # the force turns over in a few steps
    "asymmetric-coulomb": 0.02,
    "stribeck-friction": 0.02,
    "one-sided-stop": 0.02,
    "limited-slew": 0.02,
}
"""What a law that is not smooth may be off by, relative to what it changes; all others by 1 %."""


def bench(axes: int = 2) -> Campaign:
    """A bench of two springy axes and a flexible mode in open loop, played for 0.3 s."""
    shape = np.array([[1.0, 0.02, 1.0], [0.0, 1.0, 0.0]])[:axes]
    drive = np.array([[2.0, 0.0], [0.0, 3.0], [0.5, 0.0]])[:, :axes]
    omega = 2.0 * np.pi * np.array([12.0, 17.0, 90.0])
    plant = Plant("rad", omega, 0.05 * omega, drive, shape, 1.4e-3)
    drawn = draw_campaign(np.random.default_rng(1), axes)
    n = 300
    t = np.arange(n) / RATE_HZ
    wave = np.column_stack([np.sin(2 * np.pi * 9.0 * t) + 0.5 * np.sin(2 * np.pi * 31.0 * t + 1.0)] * axes)
    record = replace(drawn.records[0], wave=wave)
    return replace(
        drawn,
        plant=plant,
        rate_hz=RATE_HZ,
        records=(record,),
        scale=np.ones(axes),
        control=None,
        noise=(np.zeros((n, axes)),),
        starts=(np.zeros((3, 2)),),
        kelvin_hz=3.0,
    )


def solved(campaign: Campaign, one: Placed) -> Array:
    """Positions (n, axes) by LSODA, sample by sample, of the law's Python function."""
    plant, command = campaign.plant, campaign.records[0].wave
    modes, axes = plant.omega.size, plant.axes
    law, states = one.law.function.py_func, one.law.states

    def slope(t: float, x: Array, u: Array) -> Array:
        q, v, z = x[:modes], x[modes : 2 * modes], x[2 * modes :]
        f, dz = np.zeros(axes), np.zeros(states)
        law(t, plant.shape @ q, plant.shape @ v, u, z, dz, one.p, f, one.i, one.j)
        pushed = plant.drive @ (u + f) - 2.0 * plant.decay * v - plant.omega**2 * q
        return np.concatenate([v, pushed, dz])

    x, out = np.zeros(2 * modes + states), np.zeros_like(command)
    whole, part = 1, 0.4
    for k in range(command.shape[0]):
        out[k] = plant.shape @ x[:modes]
        for begin, end, late in ((0.0, part, whole + 1), (part, 1.0, whole)):
            u = command[k - late] if k >= late else np.zeros(axes)
            span = ((k + begin) / RATE_HZ, (k + end) / RATE_HZ)
            x = scipy.integrate.solve_ivp(
                slope, span, x, args=(u,), method="RK45", rtol=1e-8, atol=1e-12, max_step=1e-4
            ).y[:, -1]
    return out


@pytest.mark.parametrize("name", TORQUES)
def test_a_law_moves_the_bench_as_another_solver_says(name: str) -> None:
    campaign = bench()
    base = campaign.play([])
    one = placed(LAWS[name], campaign, base, 0, np.random.default_rng(5))
    (motion,) = campaign.play([one])
    change = motion.y - base[0].y
    assert np.sqrt(np.mean(change**2)) > 1e-4 * np.sqrt(np.mean(base[0].y ** 2))
    apart = motion.y - solved(campaign, one)
    assert np.sqrt(np.mean(apart**2)) <= ABRUPT.get(name, 0.01) * np.sqrt(np.mean(change**2)) + 1e-12


def test_no_law_is_missing_from_the_two_kinds_that_are_tested() -> None:
    assert {law.how for law in LAWS.values()} == {"torque", "reading", "record", "delay"}
    assert len(TORQUES) > 40


def test_a_mode_is_carried_as_its_matrix_exponential() -> None:
    omega, decay = np.array([0.0, 0.0, 3.0, 600.0, 12000.0]), np.array([0.0, 2.0, 3e-3, 300.0, 20.0])
    for h in (1e-6, 5e-5, 2e-3):
        move, add = exponentials(omega, decay, h)
        for m in range(omega.size):
            block = np.array([[0.0, 1.0, 0.0], [-(omega[m] ** 2), -2.0 * decay[m], 1.0], [0.0, 0.0, 0.0]])
            whole = scipy.linalg.expm(block * h)
            # squaring a matrix k times loses some k digits of the last place
            np.testing.assert_allclose(move[m], whole[:2, :2], rtol=1e-10, atol=1e-300)
            np.testing.assert_allclose(add[m], whole[:2, 2], rtol=1e-10)


def test_a_rigid_axis_under_a_held_torque_runs_a_parabola() -> None:
    plant = Plant("m", np.zeros(1), np.zeros(1), np.array([[4.0]]), np.ones((1, 1)), 0.0)
    force, nothing = np.full((500, 1), 0.25), np.zeros((500, 1))
    motion = integrate(plant, 500.0, force, nothing, nothing, None, np.zeros((1, 2)), [])
    t = np.arange(500) / 500.0
    np.testing.assert_allclose(motion.y[:, 0], 0.5 * t**2, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(motion.v[:, 0], t, rtol=1e-9, atol=1e-15)


def test_readings_of_the_linear_plant_are_those_of_its_filters() -> None:
    """Two computations of this generator: the loop, and the filters from which limits are taken."""
    for seed in range(8):
        campaign = draw_campaign(np.random.default_rng([3, seed]), 1 + seed % 3)
        if campaign.control is None and campaign.traits["start"] == "rest":
            for motion in campaign.play([]):
                apart = campaign.answer(motion.command) - motion.y
                assert np.max(np.abs(apart)) < 1e-8 * np.max(np.abs(motion.y))


def test_energy_of_a_conservative_law_is_kept() -> None:
    """A cubic spring without damping and torque: kinetic and potential energy stay what they were."""
    omega, cubic = 2.0 * np.pi * 10.0, 5e4
    plant = Plant("rad", np.array([omega]), np.zeros(1), np.array([[2.0]]), np.ones((1, 1)), 0.0)
    nothing, start = np.zeros((2000, 1)), np.array([[0.1, 0.0]])
    spring = Placed(LAWS["cubic-hardening"], np.array([cubic]), 0, 0)
    motion = integrate(plant, 1000.0, nothing, nothing, nothing, None, start, [spring])
    y, v = motion.y[:, 0], motion.v[:, 0]
    energy = 0.5 * v**2 + 0.5 * omega**2 * y**2 + 2.0 * cubic * y**4 / 4.0
    assert np.ptp(energy) < 1e-4 * energy[0]


def test_a_delay_of_part_of_a_sample_is_that_of_a_shifted_command() -> None:
    """A sine through a plant 0.4 samples later: its phase in steady motion falls by that much."""
    campaign = bench(1)
    t = np.arange(4000) / RATE_HZ
    command, nothing = np.sin(2 * np.pi * 20.0 * t)[:, None], np.zeros((4000, 1))
    phases = []
    for late in (0.0, 4e-4):
        motion = integrate(
            campaign.plant, RATE_HZ, command, nothing, nothing, None, np.zeros((3, 2)), [], extra_delay_s=late
        )
        phases.append(np.angle(np.sum(motion.y[2000:, 0] * np.exp(-2j * np.pi * 20.0 * t[2000:]))))
    assert phases[0] - phases[1] == pytest.approx(2 * np.pi * 20.0 * 4e-4, rel=1e-3)
