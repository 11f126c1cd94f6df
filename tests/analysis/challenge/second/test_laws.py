"""Laws are what their docstrings say: values in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.challenge.second.laws import LAWS
from analysis.challenge.second.laws.record import between
from sim_backend.effects import effect_class

NOTHING = np.zeros(1)


def torque(
    name: str, *p: float, y: float = 0.0, v: float = 0.0, u: float = 0.0, z: float = 0.0, t: float = 0.0
) -> float:
    """Torque of a law at one axis."""
    f, states = np.zeros(1), max(LAWS[name].states, 1)
    at = [np.array([value]) for value in (y, v, u)]
    LAWS[name].function.py_func(t, *at, np.full(states, z), np.zeros(states), np.array(p), f, 0, 0)
    return float(f[0])


def reading(name: str, *p: float, y: float, v: float = 0.0, u: float = 0.0, t: float = 0.0) -> float:
    """Reading of a law at one axis."""
    r = np.array([y])
    at = [np.array([value]) for value in (y, v, u)]
    LAWS[name].function.py_func(t, *at, np.zeros(2), np.array(p), r, 0, 0)
    return float(r[0])


def test_listed_and_twisted_laws_go_by_names_that_are_listed_and_others_by_none() -> None:
    for law in LAWS.values():
        if law.group == "unlisted":
            with pytest.raises(Exception, match="no effect"):
                effect_class(law.effect)
        else:
            assert effect_class(law.effect).reported() == law.effect


def test_there_are_laws_at_every_site_and_a_dozen_that_are_not_listed() -> None:
    listed = [law for law in LAWS.values() if law.group == "listed"]
    assert {law.site for law in listed} == {"structure", "drive", "sensor", "surroundings", "record"}
    assert sum(law.group == "unlisted" for law in LAWS.values()) >= 12
    assert sum(law.group == "twisted" for law in LAWS.values()) >= 4


def test_frictions_in_full_motion_have_their_size() -> None:
    assert torque("smooth-coulomb", 0.2, 1e-3, v=1.0) == pytest.approx(-0.2)
    assert torque("presliding", 0.2, 1e-3, v=1.0, z=1.0) == pytest.approx(-0.2)
    assert torque("asymmetric-coulomb", 0.2, 1e-3, 0.5, v=1.0) == pytest.approx(-0.3)
    assert torque("asymmetric-coulomb", 0.2, 1e-3, 0.5, v=-1.0) == pytest.approx(0.2)
    assert torque("stribeck-friction", 0.2, 1e-6, 0.5, 1.0, v=1e-3) == pytest.approx(-0.3, rel=1e-5)


def test_a_stop_pushes_by_its_depth_and_a_play_holds_its_torque() -> None:
    assert torque("soft-stop", 10.0, 0.5, 1e-6, 0.0, y=0.7) == pytest.approx(-2.0, rel=1e-6)
    assert abs(torque("soft-stop", 10.0, 0.5, 1e-6, 0.0, y=0.3)) < 1e-9
    assert torque("soft-play", 10.0, 0.1, y=1e-4) == pytest.approx(1e-3, rel=1e-5)
    assert torque("soft-play", 10.0, 0.1, y=-5.0) == pytest.approx(-1.0)


def test_commands_are_cut_rounded_and_swallowed() -> None:
    assert 2.0 + torque("clipped-amplifier", 0.25, 2.0, 1e-6, u=2.0) == pytest.approx(1.5)
    assert torque("clipped-amplifier", 0.25, 2.0, 1e-3, u=0.5) == 0.0
    assert 0.26 + torque("rounded-command", 0.1, u=0.26) == pytest.approx(0.3)
    assert 1.0 + torque("soft-dead-zone", 0.1, u=1.0) == pytest.approx(0.9, rel=1e-2)
    assert torque("soft-dead-zone", 0.1, u=0.0) == 0.0
    assert torque("warm-coil", 0.1, 5.0, u=2.0, z=4.0) == pytest.approx(-0.8)


def test_readings_are_rounded_and_drift() -> None:
    assert reading("rounded-reading", 0.1, y=0.26) == pytest.approx(0.3)
    assert reading("curved-drift", 2.0, 0.1, y=1.0, t=3.0) == pytest.approx(1.0 + 2.0 * 3.0 * 1.3)
    assert reading("reading-gain", 0.1, y=2.0) == pytest.approx(2.2)


def test_a_reading_between_samples_is_that_of_the_motion() -> None:
    t = np.arange(2000) / 500.0
    y, v = np.sin(2 * np.pi * 5.0 * t), 2 * np.pi * 5.0 * np.cos(2 * np.pi * 5.0 * t)
    late = between(y, v, 500.0, np.full(2000, 0.3))
    # a cubic through both ends is off by (ωh)⁴/384
    np.testing.assert_allclose(late[:-1], np.sin(2 * np.pi * 5.0 * (t[:-1] + 0.3 / 500.0)), atol=1e-7)


def test_lost_samples_repeat_the_one_before() -> None:
    y = np.arange(10000, dtype=float)
    kept = LAWS["lost-samples"].function(y, y, np.array([0.1]), 1.0, np.random.default_rng(0))
    assert np.mean(kept != y) == pytest.approx(0.1, abs=0.01)
    assert np.all((np.diff(kept) == 0.0) | (kept[1:] == y[1:]))


def test_a_fractional_damper_leads_by_a_part_of_a_right_angle() -> None:
    """In the middle of its band the phase of torque over deflection is near order · 90°, and none of a spring's 0°."""
    p, omega = np.array([1.0, 1.0, 0.5]), 1.0
    times = p[1] * 10.0 ** (1.25 - 0.625 * np.arange(5))
    gains = 10.0 ** (p[2] * 0.625 * (np.arange(5) - 2))
    response = np.sum(gains * 1j * omega * times / (1.0 + 1j * omega * times))
    assert 0.3 * 90.0 < np.degrees(np.angle(response)) < 0.7 * 90.0
    assert torque("fractional-damper", *p, y=1.0) == pytest.approx(-float(np.sum(gains)))
