"""The numbers of the nominal model that are re-tuned, against models of which one number is another."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.diagnosis.nominal.responses import coasting, simulate
from analysis.diagnosis.nominal.tuning import (
    Nuisance,
    bounds_of,
    change_to,
    deviations,
    nuisances_of,
    own_nuisances_of,
    sensitivities,
    turned,
)
from sim_backend.linear import ModalModel, discretise, played
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


def nuisance_at(nuisances: list[Nuisance], field: str, index: tuple[int, ...]) -> int:
    (at,) = [i for i, nuisance in enumerate(nuisances) if (nuisance.field, nuisance.index) == (field, index)]
    return at


def test_sensitivities_are_the_difference_of_two_models() -> None:
    linear, u = linear_model(), drive(600)
    nuisances = nuisances_of(linear, 0.03)
    columns = sensitivities(linear, nuisances, u, RATE_HZ, np.zeros((2, 2)))
    base = simulate(discretise(linear, RATE_HZ), u)
    for k, nuisance in enumerate(nuisances):
        step = np.zeros(len(nuisances))
        step[k] = 1e-4
        moved = simulate(discretise(turned(linear, nuisances, step), RATE_HZ), u)
        difference = (moved - base)[:, 0] / 1e-4
        # a forward difference errs by half a step times the curvature, here below 2 % of the column for every nuisance
        assert np.linalg.norm(difference - columns[:, 0, k]) < 0.02 * np.linalg.norm(difference), nuisance


@pytest.mark.parametrize("through_delay", [True, False], ids=["commands", "torques"])
def test_sensitivities_of_own_numbers_are_the_difference_of_two_whole_models(through_delay: bool) -> None:
    linear, u, n, step = fitted_model(), drives(600), 600, 1e-4
    start = np.array([[1e-3, 0.05], [2e-4, -0.1]])
    nuisances = own_nuisances_of(linear, late=[0])
    fields = {"b", "b_direct", "c", "c_rate", "d", "delay_s", "omega_rad_s", "sigma_1_s"}
    assert fields == {nuisance.field for nuisance in nuisances}
    if not through_delay:  # torques have passed the delay already
        nuisances = [nuisance for nuisance in nuisances if nuisance.field != "delay_s"]
    columns = sensitivities(linear, nuisances, u, RATE_HZ, start, through_delay=through_delay)
    for k, nuisance in enumerate(nuisances):

        def moved(by: float, k: int = k) -> np.ndarray:
            model = played(turned(linear, nuisances, by * np.eye(len(nuisances))[k]), RATE_HZ)
            return simulate(model, u, through_delay=through_delay) + coasting(model, start, n)

        difference = (moved(step) - moved(-step)) / (2.0 * step)
        # a central difference of a frequency errs by the square of step over damping ratio, 0.01²; all else is linear
        assert np.linalg.norm(difference - columns[:, :, k]) < 1e-3 * np.linalg.norm(difference), nuisance


def test_a_delay_turns_torques_that_have_passed_it() -> None:
    linear = fitted_model()
    nuisances = own_nuisances_of(linear, late=[0])
    k = nuisance_at(nuisances, "delay_s", (0,))
    samples = np.arange(600)
    torque = np.stack([1.0 - np.cos(samples / 40.0), np.zeros(600)], axis=1)
    column = sensitivities(linear, nuisances, torque, RATE_HZ, np.zeros((2, 2)), through_delay=False)[:, :, k]
    part, late = 1e-3, 1.7e-3  # of the delay, and that in samples
    later = np.stack([1.0 - np.cos((samples - late) / 40.0) - torque[:, 0], np.zeros(600)], axis=1)
    moved = simulate(discretise(linear, RATE_HZ), later, through_delay=False)
    # the cubic through four samples is right to third order of their angle, (1/40)³, a chord of so small a part as well
    assert np.linalg.norm(part * column - moved) < 1e-3 * np.linalg.norm(moved)


def test_a_delay_reaches_no_further_than_none() -> None:
    linear = fitted_model()
    nuisances = own_nuisances_of(linear, late=[0])
    least, most = bounds_of(nuisances)
    shortest = turned(linear, nuisances, np.where([nuisance.field == "delay_s" for nuisance in nuisances], least, 0.0))
    assert shortest.delay_s[0] == 0.0
    assert np.all((least < 0.0) & (most > 0.0))


def test_a_delay_that_was_set_is_not_turned() -> None:
    assert "delay_s" not in {nuisance.field for nuisance in own_nuisances_of(fitted_model())}


def test_own_numbers_are_turned_by_what_is_added_and_frequencies_by_factors() -> None:
    linear = fitted_model()
    for nuisance in own_nuisances_of(linear):
        value = float(getattr(linear, nuisance.field)[nuisance.index])
        by_factors = nuisance.field in ("omega_rad_s", "sigma_1_s")
        assert bool(nuisance.unit) is not by_factors, nuisance
        first, second = nuisance.turned(value, 0.5) - value, nuisance.turned(value, 1.0) - value
        expected = (np.e - 1.0) / (np.sqrt(np.e) - 1.0) if by_factors else 2.0
        assert second / first == pytest.approx(expected, rel=1e-6), nuisance


def test_what_is_added_to_a_participation_counts_in_the_size_of_the_whole() -> None:
    """At its resonance, i omega, a mode is driven by b + b_direct (2 sigma + i omega), and shows by c + i omega c_rate.

    The parts of position and rate are at right angles but for 2 sigma, which is 2 sigma/omega < 0.06 of the rate's.
    """
    linear = fitted_model()
    pole = 1j * OMEGA_RAD_S
    into = np.abs(linear.b + linear.b_direct * (2.0 * SIGMA_1_S + pole)[:, None])
    out = np.abs(linear.c + linear.c_rate * pole)
    for nuisance in own_nuisances_of(linear):
        if nuisance.field in ("b", "b_direct"):
            whole, per_rate = into[nuisance.index], OMEGA_RAD_S[nuisance.index[0]]
        elif nuisance.field in ("c", "c_rate"):
            whole, per_rate = out[nuisance.index], OMEGA_RAD_S[nuisance.index[1]]
        else:
            continue
        part = nuisance.unit * (per_rate if nuisance.field in ("b_direct", "c_rate") else 1.0)
        assert part == pytest.approx(whole, rel=0.06), nuisance


def test_a_feedthrough_counts_in_the_largest_response_at_rest_and_has_no_mode() -> None:
    linear = fitted_model()
    nuisances = own_nuisances_of(linear)
    direct = [nuisance for nuisance in nuisances if nuisance.field == "d"]
    assert [(nuisance.index, nuisance.mode) for nuisance in direct] == [((1, 0), -1)]
    into = np.hypot(linear.b[:, 0], OMEGA_RAD_S * linear.b_direct[:, 0])
    largest = np.max(np.hypot(linear.c[1], OMEGA_RAD_S * linear.c_rate[1]) * into / OMEGA_RAD_S**2)
    assert direct[0].unit == pytest.approx(max(float(largest), 2e-3), rel=1e-12)


def test_what_is_turned_is_told_by_what_imitates_it() -> None:
    linear = fitted_model()
    nuisances = own_nuisances_of(linear)
    change = np.random.default_rng(3).uniform(-2.0, 2.0, len(nuisances))
    moved = turned(linear, nuisances, change)
    np.testing.assert_allclose(change_to(linear, nuisances, moved), change, rtol=0, atol=1e-9)
    np.testing.assert_allclose(change_to(moved, nuisances, linear), -change, rtol=0, atol=1e-9)


def test_a_number_that_is_noise_about_zero_is_found_beyond_zero() -> None:
    """Readings of a model of which two numbers have the other sign: one linear step finds both, no factor either."""
    linear, u = fitted_model(), drives(600)
    rest = np.zeros((2, 2))
    b_direct, d = linear.b_direct.copy(), linear.d.copy()
    b_direct[0, 1], d[1, 0] = -5e-6, -1e-3
    true = linear.with_(b_direct=b_direct, d=d)
    residual = simulate(played(true, RATE_HZ), u) - simulate(played(linear, RATE_HZ), u)
    nuisances = own_nuisances_of(linear)
    wanted = [nuisance_at(nuisances, "b_direct", (0, 1)), nuisance_at(nuisances, "d", (1, 0))]
    columns = sensitivities(linear, [nuisances[i] for i in wanted], u, RATE_HZ, rest).reshape(-1, 2)
    change = np.zeros(len(nuisances))
    change[wanted] = np.linalg.lstsq(columns, residual.reshape(-1), rcond=None)[0]
    found = turned(linear, nuisances, change)
    # the smaller of both is 1e-8 of its unit, and differences know a column to 1e-16 / 1e-5
    assert found.b_direct[0, 1] == pytest.approx(-5e-6, rel=1e-2)
    assert found.d[1, 0] == pytest.approx(-1e-3, rel=1e-6)
    factors = nuisances_of(linear, 1.0)
    at = nuisance_at(factors, "b_direct", (0, 1))
    assert factors[at].turned(1e-6, -3.0) > 0.0
    assert change_to(linear, factors, true)[at] == 0.0


def test_deviations_are_those_of_the_nuisances_times_what_they_turn() -> None:
    linear = fitted_model()
    nuisances = own_nuisances_of(linear)
    std = np.random.default_rng(4).uniform(0.01, 0.1, len(nuisances))
    spread = deviations(linear, nuisances, std)
    turns = {(nuisance.field, nuisance.index) for nuisance in nuisances}
    for k, nuisance in enumerate(nuisances):
        step = 1e-6 * np.eye(len(nuisances))[k]
        ahead, behind = (getattr(turned(linear, nuisances, s), nuisance.field)[nuisance.index] for s in (step, -step))
        assert getattr(spread, nuisance.field)[nuisance.index] == pytest.approx(
            abs(ahead - behind) / 2e-6 * std[k], rel=1e-4
        )
    for field in ("omega_rad_s", "sigma_1_s", "b", "b_direct", "c", "c_rate", "d", "delay_s"):
        for index, value in np.ndenumerate(getattr(spread, field)):
            assert bool(value > 0.0) is ((field, index) in turns), (field, index)


def test_a_rigid_body_has_numbers_that_can_be_turned() -> None:
    """Without frequency and decay it has no pace of its own: what is added counts in its participation, per second."""
    one = np.array([[2.0]])
    none = np.zeros((1, 1))
    rigid = ModalModel(np.zeros(1), np.zeros(1), one, 1e-7 * one, one, none, none, np.zeros(1))
    nuisances = own_nuisances_of(rigid)
    assert [nuisance.field for nuisance in nuisances] == ["b", "b_direct"]
    assert [nuisance.unit for nuisance in nuisances] == pytest.approx([2.0, 2.0])
