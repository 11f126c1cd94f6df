"""The start of a record that no fit has seen, beside torques that make of it another motion than linear models do."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from analysis.diagnosis.fitting.fit import residuals_on
from analysis.diagnosis.fitting.starts import LeftFrom, left_by_best_start, starts_of
from analysis.diagnosis.nominal.responses import free_responses, simulate
from analysis.diagnosis.records.dataset import Record, Window
from sim_backend.assembly import places_of, transducers_of
from sim_backend.effects import make_effect
from sim_backend.effects.base import Effect
from sim_backend.linear import played
from sim_backend.replay import replay
from tests.analysis.diagnosis import residuals
from tests.analysis.diagnosis.two_modes import RATE_HZ, drive, linear_model, one_axis

ROWS, NOISE = 1600, 2e-6
STIFFNESS = 11.5  # of the low mode, N m/rad

UNKNOWN = np.full(4, np.inf)

START = np.array([5e-3, -0.6, 2e-4, 0.15])
"""A swing of 6 mrad by itself, three times what the drive does."""


def reading(effects: list[Effect], start: np.ndarray) -> np.ndarray:
    places, transducers, u = places_of(one_axis()), transducers_of(one_axis()), drive(ROWS, 3)
    states = start.reshape(2, 2)
    return replay(linear_model(), effects, places, transducers, u, RATE_HZ, start=states, substeps=4).reading


def each(left: Callable[[np.ndarray, int], np.ndarray]) -> LeftFrom:
    return lambda starts, rows: [left(start, rows) for start in starts]


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("backlash", {"stiffness": 0.6 * STIFFNESS, "gap": 1.2e-3}),
        ("end-stop-contact", {"stiffness": 2.0 * STIFFNESS, "damping": 100.0, "gap": 3.5e-3}),
        ("end-stop-contact", {"stiffness": 4.0 * STIFFNESS, "damping": 200.0, "gap": 2.5e-3}),
    ],
)
def test_a_start_is_found_beside_a_torque_that_makes_another_motion_of_it(name: str, numbers: dict[str, float]) -> None:
    effects = [make_effect(name, "theta_x", numbers)]
    noise = NOISE * np.random.default_rng(5).standard_normal((ROWS, 1))
    y = reading(effects, START) + noise
    free = free_responses(played(linear_model(), RATE_HZ), ROWS)
    weight = np.ones((ROWS, 1))

    def left(acting: list[Effect], start: np.ndarray, rows: int) -> np.ndarray:
        return y[:rows] - reading(acting, start)[:rows]

    found = left_by_best_start(
        each(partial(left, effects)), each(partial(left, [])), free, weight, UNKNOWN, exact=False
    )
    # four numbers were fitted: what is left is the noise and no more
    assert np.sum(found**2) < np.sum(noise**2) * (1.0 + 4.0 / ROWS)
    # a linear model's start alone leaves an error far above it
    alone = left_by_best_start(each(partial(left, effects)), each(partial(left, [])), free, weight, UNKNOWN, exact=True)
    assert np.sum(alone**2) > 100.0 * np.sum(noise**2)


def test_a_motion_that_has_died_out_before_the_weighted_samples_leaves_its_start_alone() -> None:
    """Of a mode that loses all but 1e-310 of itself there is nothing to see: a start for it would be boundless."""
    free = free_responses(played(linear_model(), RATE_HZ), ROWS)
    weight = np.ones((ROWS, 1))
    weight[:400] = 0.0
    gone = np.exp(np.log(1e-310) * np.arange(ROWS) / 400.0)[:, None, None]
    effects = [make_effect("backlash", "theta_x", {"stiffness": 0.6 * STIFFNESS, "gap": 1.2e-3})]
    y = reading(effects, START)

    def left(acting: list[Effect], start: np.ndarray, rows: int) -> np.ndarray:
        assert np.all(np.isfinite(start)) and np.all(start[4:] == 0.0)
        return y[:rows] - reading(acting, start[:4])[:rows]

    columns, spread = np.concatenate([free, gone], axis=2), np.full(5, np.inf)
    found = left_by_best_start(
        each(partial(left, effects)), each(partial(left, [])), columns, weight, spread, exact=False
    )
    assert np.linalg.norm(found[400:]) < 1e-6 * np.linalg.norm(y[400:])


def test_rows_without_weight_say_nothing_of_a_start() -> None:
    free = free_responses(played(linear_model(), RATE_HZ), ROWS)
    weight = np.ones((ROWS, 1))
    weight[900:] = 0.0
    y = reading([], START)
    y[900:] += 1.0

    def left(start: np.ndarray, rows: int) -> np.ndarray:
        return y[:rows] - reading([], start)[:rows]

    for exact in (True, False):
        found = left_by_best_start(each(left), each(left), free, weight, UNKNOWN, exact=exact)
        assert np.max(np.abs(found[:900])) < 1e-6 * np.max(np.abs(y[:900]))


@pytest.mark.parametrize("late", [4, 3.4])
def test_what_is_rounded_sees_the_motion_by_commands_on_their_way(late: float) -> None:
    """A run that is cut off while it is played: what it was told before is not logged, and comes after it began."""
    cut, rows, step = 200, 700, 2e-3
    force = np.repeat(np.random.default_rng(8).standard_normal((cut + rows) // 5), 5)
    setting, fit = residuals.setting_of(force, residuals.moved(force), np.zeros(force.size), 1e-4)
    nominal = setting.nominal.with_(delay_s=np.array([late / residuals.RATE_HZ]))
    setting = replace(setting, nominal=nominal, starts=starts_of(setting.data, nominal, setting.whitener))
    rounding = make_effect("sensor-quantisation", "x", {"step_size": step})
    fit = replace(fit, states=(np.zeros((1, 2)),), effects=(rounding,))
    rounded = step * np.floor(simulate(played(nominal, residuals.RATE_HZ), force[:, None])[cut:] / step + 0.5)
    unseen = Record("unseen", force[cut:, None], rounded, (Window("unseen", 0, rows, True),))
    data = replace(setting.data, records=(*setting.data.records, unseen))
    left = residuals_on(data, setting, fit)[1][:, 0]
    # only a reading near the middle of two steps may fall on the other side: one in a hundred, by a start a little off
    assert np.mean(np.abs(left) > 0.5 * step) < 0.01


@pytest.mark.parametrize("goes_on", [True, False])
def test_what_counts_goes_on_counting_where_an_unseen_record_is_of_the_same_recording(goes_on: bool) -> None:
    """A counter that has lost a fringe has it lost in what is recorded after; one that was set to zero has not."""
    cut, rows, noise = 900, 700, 1e-3
    rng = np.random.default_rng(8)
    force = np.repeat(rng.standard_normal((cut + rows) // 5), 5)
    true = residuals.moved(force)
    rate = np.gradient(true[:cut]) * residuals.RATE_HZ
    counter = make_effect("fringe-jump", "x", {"fringe": 0.3, "rate_limit": 0.95 * float(np.abs(rate).max())})
    setting, fit = residuals.setting_of(force[:cut], true[:cut], np.zeros(cut), noise)
    places, transducers = setting.places, setting.transducers

    def read(last: int) -> np.ndarray:
        return replay(setting.nominal, [counter], places, transducers, force[:last, None], residuals.RATE_HZ).reading

    y = read(cut + rows) + noise * rng.standard_normal((cut + rows, 1))
    lost = y[cut - 1] - true[cut - 1]
    assert abs(lost) == pytest.approx(0.3, abs=5.0 * noise)
    if not goes_on:
        y[cut:] -= 0.3 * np.sign(lost)
    record = replace(setting.data.records[0], y=y[:cut])
    unseen = Record("run", force[cut:, None], y[cut:], (Window("unseen", 0, rows, True),), first_row=cut)
    data = replace(setting.data, records=(record, unseen))
    setting = replace(setting, data=replace(data, records=(record,)))
    fit = replace(fit, states=(np.zeros((1, 2)),), effects=(counter,), residuals=(y[:cut] - read(cut),))
    left = residuals_on(data, setting, fit)[1][:, 0]
    assert np.sum(left**2) < 1.2 * noise**2 * rows


@pytest.mark.parametrize("late", [0.48, 1.0, 2.3])
def test_an_unseen_record_of_a_late_drive_leaves_noise_from_its_first_row(late: float) -> None:
    """Commands on their way nearly take each other away: as large as may be, no simulation follows them."""
    cut, rows, noise = 200, 700, 1e-3
    rng = np.random.default_rng(8)
    force = np.repeat(rng.standard_normal((cut + rows) // 5), 5)
    setting, fit = residuals.setting_of(force, residuals.moved(force), np.zeros(force.size), noise)
    nominal = setting.nominal.with_(delay_s=np.array([late / residuals.RATE_HZ]))
    setting = replace(setting, nominal=nominal, starts=starts_of(setting.data, nominal, setting.whitener))
    fit = replace(fit, states=(np.zeros((1, 2)),))
    y = simulate(played(nominal, residuals.RATE_HZ), force[:, None])[cut:] + noise * rng.standard_normal((rows, 1))
    unseen = Record("unseen", force[cut:, None], y, (Window("unseen", 0, rows, True),))
    left = residuals_on(replace(setting.data, records=(*setting.data.records, unseen)), setting, fit)[1][:, 0]
    assert np.max(np.abs(left[:20])) < 4.0 * noise
    assert np.sum(left**2) < noise**2 * (rows + 3.0 * np.sqrt(2.0 * rows))


def test_an_input_that_is_late_and_still_has_no_commands_before_a_record() -> None:
    """What is known to be nothing says nothing of the rest of the start: it is found as without it."""
    rng = np.random.default_rng(4)
    free = free_responses(played(linear_model(), RATE_HZ), ROWS)
    late = rng.standard_normal((ROWS, 1, 2)) * np.exp(-np.arange(ROWS) / 3.0)[:, None, None]
    columns, weight = np.concatenate([free, late], axis=2), np.ones((ROWS, 1))
    y = reading([], START) + NOISE * rng.standard_normal((ROWS, 1))

    def left(start: np.ndarray, rows: int) -> np.ndarray:
        return (y - reading([], np.zeros(4)) - np.einsum("nyk,k->ny", columns, start))[:rows]

    spread = np.append(UNKNOWN, [0.0, 0.0])
    found = left_by_best_start(each(left), each(left), columns, weight, spread, exact=True)
    assert np.sum(found**2) < NOISE**2 * (ROWS + 3.0 * np.sqrt(2.0 * ROWS))
