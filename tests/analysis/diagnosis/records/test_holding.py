import numpy as np
import pytest

from analysis.diagnosis.records.dataset import Record, Window
from analysis.diagnosis.records.holding import with_held_out
from sim_backend.errors import DataError

RNG = np.random.default_rng(0)
WAVE = RNG.standard_normal((1000, 2))
OTHER = RNG.standard_normal((1000, 2))


def joined(*inputs, period=0):
    u = np.concatenate(inputs)
    bounds = np.concatenate([[0], np.cumsum([x.shape[0] for x in inputs])])
    windows = tuple(
        Window(f"w{i}", int(a), int(b), period=period)
        for i, (a, b) in enumerate(zip(bounds[:-1], bounds[1:], strict=True))
    )
    return Record("run", u, np.zeros((u.shape[0], 1)), windows)


def held_labels(records):
    return [w.label for r in records for w in r.windows if w.held_out]


def test_what_was_held_out_stays_so():
    record = Record("run", WAVE, np.zeros((1000, 1)), (Window("a", 0, 500), Window("b", 500, 1000, held_out=True)))
    assert with_held_out([record]) == ((record,), None)


def test_the_last_window_of_another_amplitude_is_held_out():
    records, note = with_held_out([joined(WAVE, WAVE, WAVE, WAVE, 0.5 * WAVE)])
    assert held_labels(records) == ["w4"] and note is not None and "'w4'" in note


def test_the_last_window_of_another_waveform_is_held_out():
    records, _ = with_held_out([joined(WAVE, WAVE), joined(WAVE, OTHER)])
    assert held_labels(records) == ["w1"]
    assert held_labels(records[:1]) == []


def test_windows_that_repeat_leave_the_last_fifth_of_each_record_at_a_whole_period():
    record = joined(np.tile(WAVE, (5, 1)), period=1000)
    records, note = with_held_out([record, record])
    for one in records:
        assert [(w.start, w.stop, w.held_out) for w in one.windows] == [(0, 4000, False), (4000, 5000, True)]
    assert note is not None and "last fifth" in note


def test_at_most_a_third_is_held_out():
    # two windows that differ: the last is half of all rows, too much to give away
    records, _ = with_held_out([joined(WAVE, OTHER)])
    held = sum(w.stop - w.start for r in records for w in r.windows if w.held_out)
    assert held == 400


def test_only_held_out_windows_are_refused():
    with pytest.raises(DataError, match="all 1 segments are held out"):
        with_held_out([Record("run", WAVE, np.zeros((1000, 1)), (Window("held-out", 0, 1000, held_out=True),))])
