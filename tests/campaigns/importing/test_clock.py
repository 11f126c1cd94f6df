"""Time stamps in any unit, as dates, uneven and with rows lost."""

from __future__ import annotations

import numpy as np
import pytest

from campaigns.importing.clock import Stamps, clock_of, dates, grid_of, resampled, stamps_in, unit_in
from campaigns.log import read_run
from sim_backend.errors import ConfigError, DataError


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("time (ms)", "ms"),
        ("t [us]", "us"),
        ("t (µs)", "us"),
        ("timestamp_ns", "ns"),
        ("Time/s", "s"),
        ("elapsed, min", "min"),
        ("Zeit in ms", "ms"),
        ("[s]", "s"),
        ("milliseconds", "ms"),
        ("time", None),
        ("t", None),
        ("items", None),
        ("t (V)", None),
    ],
)
def test_units_in_names(name, unit):
    assert unit_in(name) == unit


def test_whole_numbers_lose_nothing():
    # nanoseconds since 1970 have more digits than a double
    stamps = 1_700_000_000_000_000_000 + 100_000 * np.arange(50)
    clock = clock_of(stamps_in(stamps, "ns"), "t", "")
    assert clock.rate_hz == pytest.approx(10_000.0, rel=1e-12)


@pytest.mark.parametrize(
    ("cells", "steps"),
    [
        (["2026-11-25 12:00:00.000", "2026-11-25 12:00:00.250"], 0.25),
        (["2026-11-25T12:00:00Z", "2026-11-25T12:00:02Z"], 2.0),
        (["25.11.2026 23:59:59.5", "26.11.2026 00:00:00.0"], 0.5),
        (["11/25/2026 12:00:00", "11/25/2026 12:00:01"], 1.0),
        (["23:59:59.9", "00:00:00.1"], 0.2),
        (["12:00:00,125", "12:00:00,250"], 0.125),
    ],
)
def test_dates_and_times_of_day(cells, steps):
    np.testing.assert_allclose(np.diff(dates(cells, "t").after_s), steps, rtol=1e-9)


def test_dates_that_may_be_two_are_refused():
    with pytest.raises(DataError, match="day or month first"):
        dates(["05/06/2026 12:00:00", "05/06/2026 12:00:01"], "t")
    with pytest.raises(DataError, match="'yesterday' in row 2"):
        dates(["2026-11-25 12:00:00", "yesterday"], "t")


@pytest.mark.parametrize("kind", [float, int])
def test_stamps_that_no_clock_of_seconds_shows_are_refused(tmp_path, run_map, plain, data, kind):
    np.savez(tmp_path / "a.npz", t=(1_700_000_000_000 + np.arange(500)).astype(kind), **data)
    text = plain("a.npz").replace("sample_rate_hz = 10000.0", 'time = "t"')
    with pytest.raises(DataError, match="say time_unit"):
        run_map(text)
    made = run_map(text.replace('time = "t"', 'time = "t"\ntime_unit = "ms"'))
    assert made.sample_rate_hz == pytest.approx(1000.0)


def test_a_unit_that_is_none_of_time_is_asked_about(tmp_path, run_map, plain):
    (tmp_path / "a.csv").write_text("t (ticks),tx,ax\n0,0.5,1.5\n1,0.25,2.5\n2,0.75,3.5\n")
    with pytest.raises(DataError, match="its unit is 'ticks', which is none of time"):
        run_map(plain("a.csv").replace("sample_rate_hz = 10000.0", 'time = "t (ticks)"'))
    assert unit_in("hours since 2000-01-01") == "h" and unit_in("days since 1970-01-01 00:00 UTC") == "d"


def test_two_clocks_are_counted_from_one_origin(tmp_path, run_map, plain):
    # whole milliseconds that begin at different times
    ours, theirs = 1_000_000 + np.arange(0, 1000), 999_500 + np.arange(0, 2000, 10)
    np.savez(tmp_path / "a.npz", t=ours, tx=np.sin(9e-3 * ours), tt=theirs, ax=np.cos(9e-3 * theirs))
    text = plain("a.npz").replace("sample_rate_hz = 10000.0", 'time = "t"\ntime_unit = "ms"\nresample = "cubic"')
    run_map(text.replace('role = "output"', 'role = "output"\ntime = "tt"'))
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("angle"), 1e-3 * np.cos(9e-3 * ours), atol=1e-8)


def test_a_clock_of_a_channel_must_ascend(tmp_path, run_map, plain):
    slow_s = np.arange(11) * 0.1
    slow_s[5] = 0.35
    np.savez(tmp_path / "a.npz", tx=np.sin(np.arange(900.0)), ax=np.cos(slow_s), ts=slow_s)
    text = plain("a.npz").replace("sample_rate_hz = 10000.0", 'sample_rate_hz = 1000.0\nresample = "cubic"')
    with pytest.raises(DataError, match="the clock of channel 'angle' does not ascend"):
        run_map(text.replace('role = "output"', 'role = "output"\ntime = "ts"'))


def test_a_long_gap_costs_what_a_long_gap_costs():
    full_s = np.arange(2000.0) * 1e-3
    kept = np.setdiff1d(np.arange(2000), np.arange(700, 750))
    wave = np.sin(2 * np.pi * 10.0 * full_s)
    _, grid_s = grid_of(Stamps(full_s[kept]), "t", "")
    drawn, cost = resampled(full_s[kept], wave[kept], grid_s, "cubic")
    left = np.abs(drawn[700:750] - wave[700:750]).max()
    assert left > 0.1 and cost > 0.05


def test_a_gap_of_more_than_was_measured_is_refused():
    with pytest.raises(DataError, match="gaps of more samples than were measured"):
        grid_of(Stamps(np.array([0.0, 0.1, 0.2, 0.3, 1e15])), "t", "")


def test_a_step_back_within_a_day_is_no_midnight():
    with pytest.raises(DataError, match="does not ascend"):
        grid_of(dates(["12:00:00.2", "12:00:00.1", "12:00:00.3"], "t"), "t", "")


def test_whole_seconds_without_their_fraction_are_dates_too():
    found = dates(["25.11.2026 12:00:00", "25.11.2026 12:00:00.5", "25.11.2026 12:00:01"], "t")
    np.testing.assert_allclose(found.after_s, [0.0, 0.5, 1.0])


def test_lost_rows_are_counted_and_the_way_out_is_told():
    time_s = np.delete(np.arange(100) * 1e-3, [40, 41, 70])
    with pytest.raises(DataError, match=r"3 samples are lost in 2 place\(s\).*resample = \"cubic\"") as refused:
        clock_of(Stamps(time_s), "time 't'", "")
    assert "sample_rate_hz" not in str(refused.value)


@pytest.mark.parametrize("method", ["linear", "cubic"])
def test_lost_rows_are_drawn_and_what_that_costs_is_not_told_too_small(method):
    full_s = np.arange(400) * 1e-3
    kept = np.setdiff1d(np.arange(400), [40, 41, 170, 300])
    wave = np.sin(2 * np.pi * 12.0 * full_s)
    clock, grid_s = grid_of(Stamps(full_s[kept]), "t", "")
    assert clock.rate_hz == pytest.approx(1000.0) and grid_s.size == 400
    drawn, cost = resampled(full_s[kept], wave[kept], grid_s, method)
    left = np.sqrt(np.mean((drawn - wave) ** 2)) / wave.std()
    assert left < cost < 0.05


def test_an_uneven_clock_becomes_even(tmp_path, run_map, plain):
    rng = np.random.default_rng(1)
    time_s = (np.arange(500) + rng.uniform(-0.2, 0.2, 500)) * 1e-3
    np.savez(tmp_path / "a.npz", t=time_s, tx=np.sin(40 * time_s), ax=np.cos(40 * time_s))
    text = plain("a.npz").replace("sample_rate_hz = 10000.0", 'time = "t"')
    with pytest.raises(DataError, match="resample"):
        run_map(text)
    made = run_map(text.replace('time = "t"', 'time = "t"\nresample = "cubic"'))
    assert made.sample_rate_hz == pytest.approx(1000.0, rel=1e-3)
    assert any("angle: 500 readings were resampled to 500 samples (cubic)" in remark for remark in made.remarks)
    assert all("the error is about" in remark for remark in made.remarks)
    with read_run(tmp_path / "out.h5") as run:
        at_s = run.time_s("angle")
        np.testing.assert_allclose(run.read("angle"), 1e-3 * np.cos(40 * at_s), atol=2e-6)


def test_channels_of_different_rates_are_joined_on_the_clock_of_the_log(tmp_path, run_map, plain):
    fast_s, slow_s = np.arange(1000) * 1e-3, np.arange(101) * 1e-2
    np.savez(tmp_path / "a.npz", tx=np.sin(9 * fast_s), ax=np.cos(9 * slow_s), ts=slow_s)
    own = plain("a.npz").replace("sample_rate_hz = 10000.0", "sample_rate_hz = 1000.0")
    own = own.replace('role = "output"', 'role = "output"\ntime = "ts"')
    with pytest.raises(ConfigError, match="clock of its own"):
        run_map(own)
    made = run_map(own.replace("[channels.torque]", 'resample = "cubic"\n[channels.torque]', 1))
    assert made.rows == 1000
    with read_run(tmp_path / "out.h5") as run:
        np.testing.assert_allclose(run.read("angle"), 1e-3 * np.cos(9 * fast_s), atol=1e-8)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9), ("min", 1 / 60)])
def test_a_unit_of_time_is_taken_from_the_name_and_from_the_map(tmp_path, run_map, plain, data, unit, factor):
    stamps = np.arange(500) * 1e-4 * factor
    np.savez(tmp_path / "a.npz", **{f"t ({unit})": stamps, "t": stamps}, **data)
    named = run_map(plain("a.npz").replace("sample_rate_hz = 10000.0", f'time = "t ({unit})"'))
    assert named.sample_rate_hz == pytest.approx(1e4) and named.clock == f"'t ({unit})' in {unit}"
    (tmp_path / "out.h5").unlink()
    told = run_map(plain("a.npz").replace("sample_rate_hz = 10000.0", f'time = "t"\ntime_unit = "{unit}"'))
    assert told.sample_rate_hz == pytest.approx(1e4)


def test_dates_in_a_table(tmp_path, run_map, plain):
    rows = "".join(f"2026-11-25 12:00:{s:02d}.{ms:03d},{s},{ms + 1}\n" for s in range(5) for ms in (0, 250, 500, 750))
    (tmp_path / "a.csv").write_text(f"when,tx,ax\n{rows}")
    made = run_map(plain("a.csv").replace("sample_rate_hz = 10000.0", 'time = "when"'))
    assert (made.sample_rate_hz, made.clock) == (4.0, "dates")
