"""The numbers of the nominal model that are re-tuned, against models of which one number is another."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.nominal.responses import coasting, played, simulate
from analysis.diagnosis.nominal.tuning import (
    Knob,
    deviations,
    imitation,
    knobs_of,
    own_knobs_of,
    reach_of,
    sensitivities,
    turned,
)
from sim_backend.linear import ModalModel, discretise
from tests.analysis.diagnosis.two_modes import RATE_HZ, drive, linear_model

OMEGA_RAD_S = 2.0 * np.pi * np.array([30.0, 250.0])
SIGMA_1_S = np.array([5.0, 20.0])


def fitted_model() -> ModalModel:
    """Two drives, one of them late by 1.7 samples, two readings, one of which the drive also reaches directly.

    Participations of position and of rate are of one size in some places; in others the rate's part is next to zero.
    """
    return ModalModel(
        omega_rad_s=OMEGA_RAD_S,
        sigma_1_s=SIGMA_1_S,
        b=np.array([[3000.0, -800.0], [-1500.0, 2500.0]]),
        b_direct=np.array([[12.0, 1e-6], [-1.0, 0.8]]),
        c=np.array([[1.0, 0.7], [-0.4, 1.2]]),
        c_rate=np.array([[0.0, 3e-4], [1e-3, -1e-9]]),
        d=np.array([[0.0, 0.0], [2e-3, 0.0]]),
        delay_s=np.array([1.7, 0.0]) / RATE_HZ,
    )


def drives(n: int) -> np.ndarray:
    return np.concatenate([drive(n, seed=1), drive(n, seed=2)], axis=1)


def knob_at(knobs: list[Knob], field: str, index: tuple[int, ...]) -> int:
    (at,) = [i for i, knob in enumerate(knobs) if (knob.field, knob.index) == (field, index)]
    return at


def test_sensitivities_are_the_difference_of_two_models() -> None:
    linear, u = linear_model(), drive(600)
    knobs = knobs_of(linear, 0.03)
    columns = sensitivities(linear, knobs, u, RATE_HZ, np.zeros((2, 2)))
    base = simulate(discretise(linear, RATE_HZ), u)
    for k, knob in enumerate(knobs):
        step = np.zeros(len(knobs))
        step[k] = 1e-4
        moved = simulate(discretise(turned(linear, knobs, step), RATE_HZ), u)
        difference = (moved - base)[:, 0] / 1e-4
        # a forward difference errs by half a step times the curvature, here below 2 % of the column for every knob
        assert np.linalg.norm(difference - columns[:, 0, k]) < 0.02 * np.linalg.norm(difference), knob


@pytest.mark.parametrize("through_delay", [True, False], ids=["commands", "torques"])
def test_sensitivities_of_own_numbers_are_the_difference_of_two_whole_models(through_delay: bool) -> None:
    linear, u, n, step = fitted_model(), drives(600), 600, 1e-4
    start = np.array([[1e-3, 0.05], [2e-4, -0.1]])
    knobs = own_knobs_of(linear, late=[0])
    fields = {"b", "b_direct", "c", "c_rate", "d", "delay_s", "omega_rad_s", "sigma_1_s"}
    assert fields == {knob.field for knob in knobs}
    if not through_delay:  # torques have passed the delay already
        knobs = [knob for knob in knobs if knob.field != "delay_s"]
    columns = sensitivities(linear, knobs, u, RATE_HZ, start, through_delay=through_delay)
    for k, knob in enumerate(knobs):

        def moved(by: float, k: int = k) -> np.ndarray:
            model = played(turned(linear, knobs, by * np.eye(len(knobs))[k]), RATE_HZ)
            return simulate(model, u, through_delay=through_delay) + coasting(model, start, n)

        difference = (moved(step) - moved(-step)) / (2.0 * step)
        # a central difference of a frequency errs by the square of step over damping ratio, 0.01²; all else is linear
        assert np.linalg.norm(difference - columns[:, :, k]) < 1e-3 * np.linalg.norm(difference), knob


def test_a_delay_turns_torques_that_have_passed_it() -> None:
    linear = fitted_model()
    knobs = own_knobs_of(linear, late=[0])
    k = knob_at(knobs, "delay_s", (0,))
    samples = np.arange(600)
    torque = np.stack([1.0 - np.cos(samples / 40.0), np.zeros(600)], axis=1)
    column = sensitivities(linear, knobs, torque, RATE_HZ, np.zeros((2, 2)), through_delay=False)[:, :, k]
    part, late = 1e-3, 1.7e-3  # of the delay, and that in samples
    later = np.stack([1.0 - np.cos((samples - late) / 40.0) - torque[:, 0], np.zeros(600)], axis=1)
    moved = simulate(discretise(linear, RATE_HZ), later, through_delay=False)
    # the cubic through four samples is right to third order of their angle, (1/40)³, a chord of so small a part as well
    assert np.linalg.norm(part * column - moved) < 1e-3 * np.linalg.norm(moved)


def test_a_delay_reaches_no_further_than_none() -> None:
    linear = fitted_model()
    knobs = own_knobs_of(linear, late=[0])
    least, most = reach_of(knobs)
    shortest = turned(linear, knobs, np.where([knob.field == "delay_s" for knob in knobs], least, 0.0))
    assert shortest.delay_s[0] == 0.0
    assert np.all((least < 0.0) & (most > 0.0))


def test_a_delay_that_was_set_is_not_turned() -> None:
    assert "delay_s" not in {knob.field for knob in own_knobs_of(fitted_model())}


def test_own_numbers_are_turned_by_what_is_added_and_frequencies_by_factors() -> None:
    linear = fitted_model()
    for knob in own_knobs_of(linear):
        value = float(getattr(linear, knob.field)[knob.index])
        by_factors = knob.field in ("omega_rad_s", "sigma_1_s")
        assert bool(knob.unit) is not by_factors, knob
        first, second = knob.turned(value, 0.5) - value, knob.turned(value, 1.0) - value
        expected = (np.e - 1.0) / (np.sqrt(np.e) - 1.0) if by_factors else 2.0
        assert second / first == pytest.approx(expected, rel=1e-6), knob


def test_what_is_added_to_a_participation_counts_in_the_size_of_the_whole() -> None:
    """At its resonance, i omega, a mode is driven by b + b_direct (2 sigma + i omega), and shows by c + i omega c_rate.

    The parts of position and rate are at right angles but for 2 sigma, which is 2 sigma/omega < 0.06 of the rate's.
    """
    linear = fitted_model()
    pole = 1j * OMEGA_RAD_S
    into = np.abs(linear.b + linear.b_direct * (2.0 * SIGMA_1_S + pole)[:, None])
    out = np.abs(linear.c + linear.c_rate * pole)
    for knob in own_knobs_of(linear):
        if knob.field in ("b", "b_direct"):
            whole, per_rate = into[knob.index], OMEGA_RAD_S[knob.index[0]]
        elif knob.field in ("c", "c_rate"):
            whole, per_rate = out[knob.index], OMEGA_RAD_S[knob.index[1]]
        else:
            continue
        part = knob.unit * (per_rate if knob.field in ("b_direct", "c_rate") else 1.0)
        assert part == pytest.approx(whole, rel=0.06), knob


def test_a_feedthrough_counts_in_the_largest_response_at_rest_and_has_no_mode() -> None:
    linear = fitted_model()
    knobs = own_knobs_of(linear)
    direct = [knob for knob in knobs if knob.field == "d"]
    assert [(knob.index, knob.mode) for knob in direct] == [((1, 0), -1)]
    into = np.hypot(linear.b[:, 0], OMEGA_RAD_S * linear.b_direct[:, 0])
    largest = np.max(np.hypot(linear.c[1], OMEGA_RAD_S * linear.c_rate[1]) * into / OMEGA_RAD_S**2)
    assert direct[0].unit == pytest.approx(max(float(largest), 2e-3), rel=1e-12)


def test_what_is_turned_is_told_by_what_imitates_it() -> None:
    linear = fitted_model()
    knobs = own_knobs_of(linear)
    change = np.random.default_rng(3).uniform(-2.0, 2.0, len(knobs))
    moved = turned(linear, knobs, change)
    np.testing.assert_allclose(imitation(linear, knobs, moved), change, rtol=0, atol=1e-9)
    np.testing.assert_allclose(imitation(moved, knobs, linear), -change, rtol=0, atol=1e-9)


def test_a_number_that_is_noise_about_zero_is_found_beyond_zero() -> None:
    """Readings of a model of which two numbers have the other sign: one linear step finds both, no factor either."""
    linear, u = fitted_model(), drives(600)
    rest = np.zeros((2, 2))
    b_direct, d = linear.b_direct.copy(), linear.d.copy()
    b_direct[0, 1], d[1, 0] = -5e-6, -1e-3
    true = linear.with_(b_direct=b_direct, d=d)
    residual = simulate(played(true, RATE_HZ), u) - simulate(played(linear, RATE_HZ), u)
    knobs = own_knobs_of(linear)
    wanted = [knob_at(knobs, "b_direct", (0, 1)), knob_at(knobs, "d", (1, 0))]
    columns = sensitivities(linear, [knobs[i] for i in wanted], u, RATE_HZ, rest).reshape(-1, 2)
    change = np.zeros(len(knobs))
    change[wanted] = np.linalg.lstsq(columns, residual.reshape(-1), rcond=None)[0]
    found = turned(linear, knobs, change)
    # the smaller of both is 1e-8 of its unit, and differences know a column to 1e-16 / 1e-5
    assert found.b_direct[0, 1] == pytest.approx(-5e-6, rel=1e-2)
    assert found.d[1, 0] == pytest.approx(-1e-3, rel=1e-6)
    factors = knobs_of(linear, 1.0)
    at = knob_at(factors, "b_direct", (0, 1))
    assert factors[at].turned(1e-6, -3.0) > 0.0
    assert imitation(linear, factors, true)[at] == 0.0


def test_deviations_are_those_of_the_knobs_times_what_they_turn() -> None:
    linear = fitted_model()
    knobs = own_knobs_of(linear)
    std = np.random.default_rng(4).uniform(0.01, 0.1, len(knobs))
    spread = deviations(linear, knobs, std)
    turns = {(knob.field, knob.index) for knob in knobs}
    for k, knob in enumerate(knobs):
        step = 1e-6 * np.eye(len(knobs))[k]
        ahead, behind = (getattr(turned(linear, knobs, s), knob.field)[knob.index] for s in (step, -step))
        assert getattr(spread, knob.field)[knob.index] == pytest.approx(abs(ahead - behind) / 2e-6 * std[k], rel=1e-4)
    for field in ("omega_rad_s", "sigma_1_s", "b", "b_direct", "c", "c_rate", "d", "delay_s"):
        for index, value in np.ndenumerate(getattr(spread, field)):
            assert bool(value > 0.0) is ((field, index) in turns), (field, index)


def test_a_rigid_body_has_numbers_that_can_be_turned() -> None:
    """Without frequency and decay it has no pace of its own: what is added counts in its participation, per second."""
    one = np.array([[2.0]])
    none = np.zeros((1, 1))
    rigid = ModalModel(np.zeros(1), np.zeros(1), one, 1e-7 * one, one, none, none, np.zeros(1))
    knobs = own_knobs_of(rigid)
    assert [(knob.field, knob.unit) for knob in knobs] == [("b", pytest.approx(2.0)), ("b_direct", pytest.approx(2.0))]
