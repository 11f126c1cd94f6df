from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.diagnosis.records.checks import MIN_ROWS
from analysis.diagnosis.records.loading import load_runs
from campaigns.importing import import_run
from campaigns.log import Channel, sha256_of
from sim_backend.errors import ConfigError, DataError
from sim_backend.model import Port


def repeating(motion, period):
    """The motion with a command that repeats after so many rows."""
    command = np.resize(motion["command_x"][:period], motion["command_x"].size)
    return motion | {"command_x": command}


Segment = tuple[str, int, int, dict[str, Any]]
HALVES: list[Segment] = [("steps", 0, 2000, {}), ("held-out noise", 2000, 4000, {})]
RATE_HZ = 1000.0


def test_segments_of_one_bench_run_stay_one_record(write_log, motion, oscillator):
    motion = repeating(motion, 500)
    path = write_log(
        motion, [("a", 100, 2000, {"period_samples": 500}), ("held-out b", 2000, 4000, {})], run_uid="uid-1"
    )
    loaded = load_runs([path], oscillator)
    (record,) = loaded.data.records
    assert record.name == "uid-1"
    np.testing.assert_array_equal(record.u[:, 0], motion["command_x"][100:])
    np.testing.assert_array_equal(record.y[:, 0], motion["x"][100:])
    # the record begins with its first window, and windows count from there
    assert [(w.label, w.start, w.stop, w.held_out, w.period) for w in record.windows] == [
        ("a", 0, 1900, False, 500),
        ("held-out b", 1900, 3900, True, 0),
    ]
    assert loaded.notes == ()
    assert [(s.file, s.sha256, s.run_uid, s.rows) for s in loaded.sources] == [
        (str(path), sha256_of(path), "uid-1", 3900)
    ]


@pytest.mark.parametrize(
    ("settings", "configuration"),
    [
        ({"realisation": 0, "period_samples": 1000}, {"map": '[log]\ntest="t"\n', "sources": []}),
        ({}, {"map": '[log]\ntest = "t"\n[[parts]]\nlabel = "steps"\n', "sources": []}),
    ],
)
def test_realisations_and_parts_of_which_nothing_is_known_are_records_of_their_own(
    write_log, motion, oscillator, settings, configuration
):
    segments = [(label, start, stop, settings) for label, start, stop, _ in HALVES]
    motion = repeating(motion, 1000)
    path = write_log(motion, segments, bench={"kind": "imported", "name": "b"}, configuration=configuration)
    records = load_runs([path], oscillator).data.records
    assert [r.n for r in records] == [2000, 2000]
    assert [w.held_out for r in records for w in r.windows] == [False, True]
    np.testing.assert_array_equal(records[1].u[:, 0], motion["command_x"][2000:])


MAP_OF_PARTS = """
[log]
test = "steps"
sample_rate_hz = 1000.0
[channels.command_x]
select = "u"
unit = "N"
role = "input"
dof = "x"
[channels.x]
select = "x"
unit = "m"
role = "output"
dof = "x"
[[parts]]
label = "steps"
source = "first.csv"
[[parts]]
label = "held-out noise"
source = "second.csv"
"""


@pytest.mark.parametrize(("second", "records"), [(slice(2000, 4000), [4000]), (slice(1000, 3000), [2000, 2000])])
def test_parts_that_were_one_recording_are_one_record(tmp_path, motion, oscillator, second, records):
    """A recording that was cut into two files goes on; one that begins elsewhere in its motion does not."""
    columns = np.stack([motion["command_x"], motion["x"]], axis=1)
    for name, rows in (("first", slice(0, 2000)), ("second", second)):
        np.savetxt(tmp_path / f"{name}.csv", columns[rows], delimiter=",", header="u,x", comments="")
    (tmp_path / "map.toml").write_text(MAP_OF_PARTS, encoding="utf-8")
    import_run(tmp_path / "map.toml", tmp_path / "run.h5")
    loaded = load_runs([tmp_path / "run.h5"], oscillator).data.records
    assert [r.n for r in loaded] == records
    assert [w.held_out for r in loaded for w in r.windows] == [False, True]


def test_segments_cut_from_one_imported_record_continue(write_log, motion, oscillator):
    map_text = '[log]\ntest = "t"\n[segments]\nsteps = [0, 2000]\n'
    path = write_log(motion, HALVES, bench={"kind": "imported", "name": "b"}, configuration={"map": map_text})
    assert [r.n for r in load_runs([path], oscillator).data.records] == [4000]


def test_channels_are_found_by_name_before_degree_of_freedom(write_log, motion, oscillator):
    channels = [
        Channel("other", "N", "input", "x", RATE_HZ),
        Channel("force", "N", "input", "elsewhere", RATE_HZ),
        Channel("x", "m", "output", "x", RATE_HZ),
    ]
    values = {"other": motion["command_x"] + 1.0, "force": motion["command_x"], "x": motion["x"]}
    loaded = load_runs([write_log(values, HALVES, channels=channels)], oscillator)
    np.testing.assert_array_equal(loaded.data.records[0].u[:, 0], motion["command_x"])
    assert "other" in loaded.notes[0] and "error of the model" in loaded.notes[0]


def test_a_model_of_other_channels_is_refused_with_what_there_is(write_log, motion, oscillator):
    path = write_log(motion, HALVES)
    strange = type(oscillator)(
        name="s",
        sample_rate_hz=RATE_HZ,
        inputs=[Port(name="torque", unit="N m", dof="theta_x")],
        outputs=oscillator.outputs,
        modes=[],
    )
    with pytest.raises(ConfigError, match=r"run.h5: no input channel for the model's input 'torque'.*command_x \(x\)"):
        load_runs([path], strange)


def test_two_channels_for_one_port_are_refused(write_log, motion, oscillator):
    channels = [Channel(n, "N", "input", "x", RATE_HZ) for n in ("a", "b")] + [
        Channel("x", "m", "output", "x", RATE_HZ)
    ]
    values = {"a": motion["command_x"], "b": motion["command_x"], "x": motion["x"]}
    with pytest.raises(ConfigError, match="2 input channels for the model's input 'force'"):
        load_runs([write_log(values, HALVES, channels=channels)], oscillator)


@pytest.mark.parametrize("unit", ["V", "rad"])
def test_another_unit_is_refused(write_log, motion, oscillator, unit):
    channels = [Channel("command_x", "N", "input", "x", RATE_HZ), Channel("x", unit, "output", "x", RATE_HZ)]
    with pytest.raises(ConfigError, match=f"'x' is in {unit}, the model's output 'x' in m"):
        load_runs([write_log(motion, HALVES, channels=channels)], oscillator)


def test_one_run_twice_and_rates_that_differ_are_refused(write_log, motion, oscillator):
    first = write_log(motion, HALVES)
    with pytest.raises(ConfigError, match="are the same run"):
        load_runs([first, first], oscillator)
    with pytest.raises(DataError, match="was sampled at 2000 Hz, .* at 1000 Hz"):
        load_runs([first, write_log(motion, HALVES, name="fast.h5", rate_hz=2000.0)], oscillator)


def test_a_constant_output_is_refused(write_log, motion, oscillator):
    with pytest.raises(DataError, match="output 'x' is constant at 0.25"):
        load_runs([write_log(motion | {"x": np.full(4000, 0.25)}, HALVES)], oscillator)


def test_constant_inputs_are_refused(write_log, motion, oscillator):
    with pytest.raises(DataError, match="every input is constant"):
        load_runs([write_log(motion | {"command_x": np.ones(4000)}, HALVES)], oscillator)


def test_rows_of_a_saturated_output_are_left_out_with_its_limit(write_log, motion, oscillator):
    top = 0.5 * np.abs(motion["x"]).max()
    loaded = load_runs([write_log(motion | {"x": np.clip(motion["x"], -top, top)}, HALVES)], oscillator)
    assert any(f"x is cut off at {top:.6g}" in note for note in loaded.notes)
    for record in loaded.data.records:
        assert np.abs(record.y[record.fitted() | record.held_out()]).max() < top


def test_a_number_that_is_not_finite_is_refused_with_its_row(write_log, motion, oscillator):
    broken = motion["x"].copy()
    broken[1234] = np.nan
    with pytest.raises(DataError, match=r"run.h5: channel 'x' holds nan in sample 1234"):
        load_runs([write_log(motion | {"x": broken}, HALVES)], oscillator)


def test_too_few_rows_are_refused(write_log, motion, oscillator):
    few = {k: v[: MIN_ROWS + 10] for k, v in motion.items()}
    segments: list[Segment] = [("a", 0, MIN_ROWS - 1, {}), ("held-out", MIN_ROWS - 1, MIN_ROWS + 10, {})]
    with pytest.raises(DataError, match=f"{MIN_ROWS - 1} samples may be fitted, at least {MIN_ROWS}"):
        load_runs([write_log(few, segments)], oscillator)


def test_nothing_left_to_fit_is_refused(write_log, motion, oscillator):
    with pytest.raises(DataError, match="all 1 segments are held out"):
        load_runs([write_log(motion, [("held-out all", 0, 4000, {})])], oscillator)


def test_what_is_no_log_is_refused(tmp_path, oscillator):
    text = tmp_path / "notes.h5"
    text.write_text("no log")
    with pytest.raises(DataError, match=r"notes.h5"):
        load_runs([text], oscillator)
    with pytest.raises(ConfigError, match="no log was given"):
        load_runs([], oscillator)


def test_a_run_without_segments_is_one_window_of_which_the_end_is_held_out(write_log, motion, oscillator):
    loaded = load_runs([write_log(motion, [])], oscillator)
    windows = loaded.data.records[0].windows
    assert [(w.label, w.start, w.stop, w.held_out) for w in windows] == [
        ("record", 0, 3200, False),
        ("record, end", 3200, 4000, True),
    ]
    assert "last fifth" in loaded.notes[0]


def test_an_aborted_run_is_used_and_said_to_be_one(write_log, motion, oscillator):
    loaded = load_runs([write_log(motion, HALVES, status="aborted")], oscillator)
    assert "run.h5 ended as aborted" in loaded.notes[0]


def test_temperature_is_read_only_where_every_run_has_it(write_log, motion, oscillator):
    channels = [
        Channel("command_x", "N", "input", "x", RATE_HZ),
        Channel("x", "m", "output", "x", RATE_HZ),
        Channel("temperature", "K", "aux", "", RATE_HZ),
    ]
    warm = motion | {"temperature": np.linspace(77.0, 78.0, 4000)}
    with_it = write_log(warm, HALVES, channels=channels)
    loaded = load_runs([with_it], oscillator)
    np.testing.assert_array_equal(loaded.data.records[0].temperature_k, warm["temperature"])
    both = load_runs([with_it, write_log(motion, HALVES, name="cold.h5")], oscillator)
    assert all(r.temperature_k is None for r in both.data.records)


def test_long_runs_are_thinned_within_bounds_and_keep_whole_periods(write_log, motion, oscillator):
    segments = [("periodic", 0, 2000, {"period_samples": 100}), ("held-out noise", 2000, 4000, {})]
    loaded = load_runs([write_log(repeating(motion, 100), segments)], oscillator, max_rows=1500)
    rows = [r.n for r in loaded.data.records]
    assert sum(rows) <= 1500
    starts = [np.flatnonzero(motion["x"] == r.y[0, 0])[0] for r in loaded.data.records]
    ends = [start + n for start, n in zip(starts, rows, strict=True)]
    # beginning and end of both segments are among the pieces, in order and apart
    assert starts[0] == 0 and 2000 in ends and ends[-1] == 4000
    assert all(b <= a for b, a in zip(ends[:-1], starts[1:], strict=True))
    for record in loaded.data.records:
        (w,) = record.windows
        assert not w.period or (w.stop - w.start) % w.period == 0
    assert "4000 samples were recorded" in loaded.notes[0]


def test_of_many_short_segments_some_are_used_with_two_periods_each(write_log, motion, oscillator):
    labels = ["held-out" if k % 4 == 3 else "segment" for k in range(40)]
    segments = [(f"{label} {k}", 100 * k, 100 * (k + 1), {"period_samples": 30}) for k, label in enumerate(labels)]
    loaded = load_runs([write_log(repeating(motion, 30), segments)], oscillator, max_rows=1200)
    records = loaded.data.records
    assert 900 <= sum(r.n for r in records) <= 1300
    assert all(r.n == 60 and r.windows[0].period == 30 for r in records)
    held = [r.windows[0].held_out for r in records]
    assert sum(held) == 5 and len(held) == 20
    # from the first segments to the last ones
    first, last = (np.flatnonzero(motion["x"] == records[i].y[0, 0])[0] for i in (0, -1))
    assert first < 400 and last > 3600
    assert f"in {len(held)} of 40 segments" in loaded.notes[0]


def test_paths_may_be_texts(write_log, motion, oscillator):
    path: Path = write_log(motion, HALVES)
    assert load_runs([str(path)], oscillator).sources[0].file == str(path)
