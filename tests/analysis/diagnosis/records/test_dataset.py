"""Records of whole periods: what is played before what is fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.diagnosis.records.dataset import Dataset, Record, Window

PERIOD = 50
WAVE = np.random.default_rng(0).standard_normal((PERIOD, 2))


def periodic(n_periods: int, size: float = 1.0) -> Record:
    u = np.concatenate([size * WAVE] * n_periods)
    y = size * np.arange(u.shape[0], dtype=float)[:, None]
    warm = 80.0 + np.arange(u.shape[0], dtype=float)
    return Record("run", u, y, (Window("w", 0, u.shape[0], period=PERIOD),), warm)


@pytest.mark.parametrize("n_periods", [2, 3, 5])
def test_an_even_fit_is_to_the_last_period_after_the_one_before_it(n_periods: int) -> None:
    record = periodic(n_periods)
    (even,) = Dataset(100.0, (record,)).evenly().records
    assert even.n == 2 * PERIOD
    np.testing.assert_array_equal(even.fitted(), np.repeat([False, True], PERIOD))
    np.testing.assert_array_equal(even.u, record.u[-2 * PERIOD :])
    np.testing.assert_array_equal(even.y, record.y[-2 * PERIOD :])
    assert even.temperature_k is not None and record.temperature_k is not None
    np.testing.assert_array_equal(even.temperature_k, record.temperature_k[-2 * PERIOD :])


def test_an_even_fit_leaves_other_records_whole_and_weighs_them_by_their_size() -> None:
    quiet, loud = periodic(1), periodic(1, 4.0)
    even = Dataset(100.0, (quiet, loud)).evenly().records
    assert [r.n for r in even] == [PERIOD, PERIOD]
    assert even[0].weight / even[1].weight == pytest.approx(4.0)


def test_a_record_of_whole_periods_is_led_in_by_one_of_which_no_row_counts() -> None:
    record = periodic(2)
    led = record.led_in()
    assert led.n == 3 * PERIOD
    np.testing.assert_array_equal(led.fitted(), np.repeat([False, True, True], PERIOD))
    np.testing.assert_array_equal(led.u[PERIOD:], record.u)
    np.testing.assert_array_equal(led.u[:PERIOD], WAVE)
    assert led.temperature_k is not None and record.temperature_k is not None
    np.testing.assert_array_equal(led.temperature_k[PERIOD:], record.temperature_k)
    broken = Record("r", record.u[:70], record.y[:70], (Window("w", 0, 70, period=PERIOD),))
    assert broken.led_in() is broken


def test_what_precedes_a_record_keeps_its_missing_rows_in_their_places() -> None:
    missing = np.arange(8) == 5
    record = Record("r", np.arange(8.0)[:, None], np.zeros((8, 1)), (Window("p", 0, 8, False, 4),), missing=missing)
    led, commanded = record.led_in(), record.after(np.full((3, 1), -1.0))
    assert led.missing is not None and commanded.missing is not None
    assert np.flatnonzero(led.missing).tolist() == [9]
    assert np.flatnonzero(commanded.missing).tolist() == [8]
    assert (
        commanded.u[:4, 0].tolist() == [-1.0, -1.0, -1.0, 0.0]
        and commanded.fitted().tolist() == [False] * 3 + [True] * 8
    )


def test_two_records_of_a_log_are_one_where_the_second_begins_with_the_sample_after_the_first():
    whole = Record("r", np.arange(10.0)[:, None], np.arange(10.0)[:, None], (Window("all", 0, 10),), first_row=20)
    first, second = whole.cut(0, 6, (Window("a", 0, 6),)), whole.cut(6, 10, (Window("b", 1, 4, True),))
    second = replace(second, missing=np.arange(4) == 2)
    assert second.follows(first) and not first.follows(second) and not second.follows(whole)
    assert not replace(second, name="other").follows(first)
    both = second.going_on_from(first)
    np.testing.assert_array_equal(both.u, whole.u)
    np.testing.assert_array_equal(both.y, whole.y)
    assert both.windows == (Window("a", 0, 6), Window("b", 7, 10, True))
    assert both.missing is not None and np.flatnonzero(both.missing).tolist() == [8] and both.temperature_k is None


@pytest.mark.parametrize(("swing", "fades"), [(0.0, False), (3.0, False), (10.0, True)])
def test_a_motion_fades_that_differs_more_in_the_first_periods_than_noise_does(swing: float, fades: bool) -> None:
    """A swing from rest loses half of itself in a period, and differs from the next by the other half."""
    rng, n_periods = np.random.default_rng(7), 5
    samples = np.arange(n_periods * PERIOD)
    noise = rng.standard_normal((samples.size, 1))
    y = np.tile(WAVE[:, :1], (n_periods, 1)) + noise + (swing * 0.5 ** (samples / PERIOD) * np.cos(samples))[:, None]
    window = Window("w", 0, samples.size, period=PERIOD)
    assert Record("run", np.tile(WAVE, (n_periods, 1)), y, (window,)).fades is fades
    # of two periods there is one difference: nothing to compare it with
    few = Record("run", np.tile(WAVE, (2, 1)), y[: 2 * PERIOD], (Window("w", 0, 2 * PERIOD, period=PERIOD),))
    assert not few.fades
