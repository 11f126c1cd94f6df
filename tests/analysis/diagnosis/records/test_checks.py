"""Records that decide nothing are refused, and copies of a period are not taken for a noise of zero."""

from __future__ import annotations

import numpy as np
import pytest

from analysis import diagnose
from analysis.diagnosis.nominal.responses import simulate
from analysis.diagnosis.records.checks import without_copies, without_cut_off
from analysis.diagnosis.records.dataset import Record, Window
from campaigns.facts.clipping import cut_off_in
from sim_backend.errors import DataError
from sim_backend.linear import discretise
from sim_backend.model import Model

RATE_HZ = 1000.0


def test_periods_that_are_copies_are_taken_as_not_repeating() -> None:
    rng = np.random.default_rng(4)
    one = rng.standard_normal((100, 2))
    tiled = np.tile(one, (3, 1))
    alive = tiled + np.array([0.0, 1e-9]) * rng.standard_normal(tiled.shape)
    record = Record("r", np.tile(one[:, :1], (3, 1)), alive, (Window("w", 0, 300, period=100),))
    (plain,), (note,) = without_copies([record], ["x", "y"])
    assert plain.windows[0].period == 0 and "periods of x are copies" in note
    noisy = Record("r", record.u, alive + 1e-9 * rng.standard_normal(alive.shape), record.windows)
    assert without_copies([noisy], ["x", "y"]) == ((noisy,), [])


def test_of_copies_of_all_outputs_one_is_left() -> None:
    rng = np.random.default_rng(4)
    u, y = (np.tile(rng.standard_normal((100, width)), (4, 1)) for width in (1, 2))
    windows = (Window("a", 0, 200, period=100), Window("b", 200, 400, held_out=True, period=100))
    (first, second), (note,) = without_copies([Record("r", u, y, windows, temperature_k=np.arange(400.0))], ["x", "y"])
    assert first.windows == (Window("a", 0, 100),) and second.windows == (Window("b", 0, 100, held_out=True),)
    assert np.array_equal(first.y, y[:100]) and np.array_equal(first.u, u[:100])
    assert second.temperature_k is not None
    assert np.array_equal(second.temperature_k, np.arange(300.0, 400.0)) and "one of them is used" in note


@pytest.mark.parametrize("seed", [5, 7, 100, 101, 107])
def test_a_right_model_of_averaged_and_tiled_data_is_consistent_with_a_remark(oscillator: Model, seed: int) -> None:
    """Four copies of one noise are no more evidence than one: half of such records were given a cause."""
    rng = np.random.default_rng(seed)
    u = np.tile(rng.standard_normal((1000, 1)), (4, 1))
    y = simulate(discretise(oscillator.linear(), RATE_HZ), u)[3000:]
    tiled = np.tile(y + 0.01 * float(np.std(y)) * rng.standard_normal(y.shape), (4, 1))
    found = diagnose(u, tiled, RATE_HZ, oscillator, period=1000)
    assert any("copies of each other" in note for note in found.notes)
    assert found.verdict == "consistent", found.sentence
    assert all(np.isfinite(estimate.std) for cause in found.causes for estimate in cause.parameters.values())
    assert found.gain is not None and np.isfinite(found.gain.noise_floor) and found.gain.noise_floor > 1e-3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda u, y: (u, 0.0 * y + 0.25), "output 'x' is constant at 0.25"),
        (lambda u, y: (0.0 * u, y), "every input is constant"),
        (lambda u, y: (u[:40], y[:40]), "at least 60 are needed"),
    ],
)
def test_arrays_that_decide_nothing_are_refused_as_logs_are(oscillator: Model, change, words: str) -> None:
    from scipy.signal import lfilter

    u = np.random.default_rng(1).standard_normal(4000)
    inputs, outputs = change(u, lfilter([1e-3], [1.0, -1.95, 0.97], u))
    with pytest.raises(DataError, match=words):
        diagnose(inputs, outputs, RATE_HZ, oscillator)


def test_rows_at_the_end_of_a_sensor_are_left_out(oscillator: Model) -> None:
    rng = np.random.default_rng(1)
    u = rng.standard_normal((4000, 1))
    y = simulate(discretise(oscillator.linear(), RATE_HZ), u)
    y = y + 1e-3 * y.std() * rng.standard_normal(y.shape)
    low, high = np.quantile(y, [0.02, 0.98])
    (record,) = (Record("r", u, np.clip(y, low, high), (Window("w", 0, 4000),)),)
    facts = cut_off_in(record.y[:, 0], "x", "rad", "w")
    (kept,), notes = without_cut_off([record], ["x"], facts)
    assert len(notes) == 2 and all("cut off at" in note for note in notes)
    fitted = kept.fitted()
    assert not np.any(np.isin(kept.y[fitted], (low, high))) and fitted.mean() > 0.85
    found = diagnose(u, record.y, RATE_HZ, oscillator)
    assert found.verdict == "consistent"


def test_nothing_is_left_where_nothing_was_measured() -> None:
    y = np.array([[0.0], [1.0], [9.0], [9.0], [4.0]])
    record = Record("r", np.ones((5, 1)), y, (), missing=np.array([False, False, True, True, False]))
    np.testing.assert_allclose(record.left_by(np.zeros((5, 1)))[:, 0], [0.0, 1.0, 2.0, 3.0, 4.0])
    assert y[2, 0] == 9.0
