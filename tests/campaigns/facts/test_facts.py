"""Each fact is found in a record that has it, with its numbers, and in none that has not."""

from __future__ import annotations

import numpy as np
import pytest

import campaigns.facts.finding
from campaigns.facts import Fact, Seen, facts_of, found_in, measured_segments, usable_segments
from campaigns.facts.period import period_of
from campaigns.log import Channel, LogSegment, LogWriter, read_run
from sim_backend.errors import DataError

RATE_HZ = 500.0


def multisine(period: float, rows: int, highest: int = 30, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0.0, 2.0 * np.pi, highest)
    t = np.arange(rows) / period
    return np.asarray(sum(np.cos(2 * np.pi * (k + 1) * t + p) for k, p in enumerate(phases)))


def seen(u: np.ndarray, y: np.ndarray, *segments: LogSegment) -> Seen:
    channels = {
        "u": Channel("u", "N m", "input", "a", RATE_HZ),
        "y": Channel("y", "rad", "output", "a", RATE_HZ),
    }
    return Seen({"u": u, "y": y}, channels, segments or (LogSegment("record", 0, u.size, {}),), RATE_HZ)


def plain(rows: int = 3000) -> tuple[np.ndarray, np.ndarray]:
    u = multisine(500, rows)
    noise = np.random.default_rng(3).standard_normal(rows)
    return u, 1e-3 * (np.convolve(u, np.exp(-np.arange(60) / 12.0))[:rows] + 0.01 * noise)


def of(record: Seen, name: str) -> list[Fact]:
    return [fact for fact in found_in(record) if fact.name == name]


def test_an_ordinary_record_is_told_nothing_about():
    u, y = plain()
    record = seen(u, y, LogSegment("record", 0, u.size, {"period_samples": 500}))
    assert [fact.name for fact in found_in(record) if fact.remark or fact.forbids] == []
    (size,) = [fact for fact in of(record, "size") if fact.channel == "y"]
    assert size.numbers["largest"] == y.max() and size.numbers["rms"] == pytest.approx(y.std())


@pytest.mark.parametrize(("claimed", "right"), [(499, 500), (501, 500), (450, 500), (260, 500)])
def test_a_wrong_period_is_forbidden_and_the_right_one_proposed(claimed, right):
    u, y = plain()
    (fact,) = of(seen(u, y, LogSegment("record", 0, u.size, {"period_samples": claimed})), "period")
    assert fact.forbids and fact.numbers["right"] == right and f"say period = {right}" in fact.finding


def test_a_slow_input_on_a_fast_clock_is_off_by_one_as_well():
    u = multisine(10_000, 40_000, highest=8)
    (fact,) = of(seen(u, u, LogSegment("record", 0, u.size, {"period_samples": 9_999})), "period")
    assert fact.forbids and fact.numbers["right"] == 10_000


def test_a_measured_input_may_be_noisy_and_several_periods_are_one():
    u, y = plain()
    u = u + 0.02 * u.std() * np.random.default_rng(1).standard_normal(u.size)
    for claimed in (500, 1000):
        (fact,) = of(seen(u, y, LogSegment("record", 0, u.size, {"period_samples": claimed})), "period")
        assert not fact.forbids


@pytest.mark.parametrize("off", [0.004, 0.05, 0.3, -0.3])
def test_a_period_of_another_clock_is_not_a_whole_number_of_samples(off):
    u = multisine(500.0 + off, 3000, highest=100)
    (fact,) = of(seen(u, u, LogSegment("record", 0, u.size, {"period_samples": 500})), "period")
    assert fact.forbids and fact.refuses_import and fact.numbers["right"] == 0
    assert f"its period is {500.0 + off:.2f} samples, not a whole number: take the period out" in fact.finding
    assert period_of({"u": u}) == 0
    (fact,) = of(seen(u, u, LogSegment("record", 0, u.size, {"period_samples": 490})), "period")
    assert "not a whole number: take the period out" in fact.finding


def test_several_periods_may_be_a_whole_number_of_samples_where_one_is_not():
    u = multisine(1000.0 / 7.0, 3000, highest=20)
    (fact,) = of(seen(u, u, LogSegment("record", 0, u.size, {"period_samples": 143})), "period")
    assert fact.forbids and fact.numbers["right"] == 1000
    assert "after 1000 it does, to 0.00 %: say period = 1000" in fact.finding
    assert period_of({"u": u[:1900]}) == 0 and period_of({"u": u}) == 1000


@pytest.mark.parametrize("seed", range(5))
def test_no_shift_is_seen_in_the_noise_of_a_measured_input(seed):
    u = multisine(500, 3000)
    u = u + 0.01 * u.std() * np.random.default_rng(seed).standard_normal(u.size)
    (fact,) = of(seen(u, u, LogSegment("record", 0, u.size, {"period_samples": 500})), "period")
    assert not fact.forbids and period_of({"u": u}) == 500


def test_what_repeats_after_nothing_is_forbidden_without_a_proposal():
    u = np.random.default_rng(1).standard_normal(3000)
    (fact,) = of(seen(u, u, LogSegment("record", 0, u.size, {"period_samples": 500})), "period")
    assert fact.forbids and fact.numbers["right"] == 0


@pytest.mark.parametrize("every", [2, 4, 7])
def test_a_slow_sensor_is_recognised_by_its_beat(every):
    u, y = plain()
    held = y[(np.arange(y.size) // every) * every]
    (fact,) = of(seen(u, held), "slow-sensor")
    assert fact.numbers["every"] == every and fact.remark


def test_lost_samples_have_no_beat_and_counts_are_neither():
    u, y = plain()
    lost = np.random.default_rng(2).uniform(size=y.size) < 0.1
    held = y[np.maximum.accumulate(np.where(lost, 0, np.arange(y.size)))]
    (fact,) = of(seen(u, held), "repeated")
    assert fact.numbers["share"] == pytest.approx(0.1, abs=0.03)
    coarse = np.round(y / y.std(), 0) * y.std()
    assert of(seen(u, coarse), "repeated") == [] == of(seen(u, coarse), "slow-sensor")
    (steps,) = [fact for fact in of(seen(u, coarse), "steps") if fact.channel == "y"]
    assert steps.numbers["step"] == pytest.approx(y.std()) and steps.remark


def test_a_sensor_at_its_end():
    u, y = plain()
    level = 0.8 * y.max()
    (fact,) = of(seen(u, np.minimum(y, level)), "clipping")
    assert fact.numbers["level"] == level and fact.numbers["share"] > 1e-3


def test_an_angle_that_wraps():
    u, _ = plain()
    turning = np.cumsum(0.01 + 0.001 * u / np.abs(u).max())
    (fact,) = of(seen(u, turning % 1.0), "wraps")
    assert fact.numbers["jump"] == pytest.approx(1.0, abs=0.02)


def test_degrees_on_microradians_are_remarked():
    u, y = plain()
    degrees = y / y.std() * np.pi
    assert [fact.channel for fact in of(seen(u, degrees), "size") if fact.remark] == ["y"]


def test_rows_at_rest_and_after_the_end_are_not_used(tmp_path):
    u, y = plain()
    u[2000:], y[2000:] = 0.0, 0.0
    channels = [Channel("u", "N m", "input", "a", RATE_HZ), Channel("y", "rad", "output", "a", RATE_HZ)]
    with LogWriter.create(tmp_path / "a.h5", channels, test="t", bench={"kind": "imported", "name": "n"}) as log:
        for label, start, stop in (("levels", 0, 2400), ("held-out levels", 2400, 3000)):
            with log.segment(label, {}):
                log.append({"u": u[start:stop], "y": y[start:stop]})
    with read_run(tmp_path / "a.h5") as run:
        facts = {fact.name: fact for fact in facts_of(run)}
        assert '0 in all of "held-out levels", samples 2400 to 3000' in facts["at-rest"].finding
        assert facts["ended"].numbers["start"] == 2000
        assert [(s.label, s.start, s.stop) for s in usable_segments(run)] == [("levels", 0, 2000)]


def test_a_forbidden_log_is_refused_with_its_reason(tmp_path):
    u, y = plain()
    channels = [Channel("u", "N m", "input", "a", RATE_HZ), Channel("y", "rad", "output", "a", RATE_HZ)]
    with (
        LogWriter.create(tmp_path / "a.h5", channels, test="t", bench={"kind": "imported", "name": "n"}) as log,
        log.segment("levels", {"period_samples": 499}),
    ):
        log.append({"u": u, "y": y})
    with read_run(tmp_path / "a.h5") as run, pytest.raises(DataError, match="say period = 500"):
        usable_segments(run)


def test_rows_at_the_end_of_a_sensor_are_cut_out_of_segments(tmp_path):
    u, y = plain()
    top = np.sort(y)[-40]
    channels = [Channel("u", "N m", "input", "a", RATE_HZ), Channel("y", "rad", "output", "a", RATE_HZ)]
    slow = np.repeat(y[:300], 10)  # stays at its end for longer than three rows
    with (
        LogWriter.create(tmp_path / "a.h5", channels, test="t", bench={"kind": "imported", "name": "n"}) as log,
        log.segment("levels", {}),
    ):
        log.append({"u": u, "y": np.minimum(np.interp(np.arange(3000), np.arange(0, 3000, 10), slow[::10]), top)})
    with read_run(tmp_path / "a.h5") as run:
        clipped = [fact for fact in facts_of(run) if fact.name == "clipping"]
        pieces = measured_segments(run)
        rows = np.concatenate([run.read("y", s.start, s.stop) for s in pieces])
    assert len(clipped) == 1 and len(pieces) >= 2
    assert rows.max() < top and all(s.rows >= 100 and s.label == "levels" for s in pieces)


def test_a_bench_that_rests_between_pulses_has_not_ended():
    pulse = np.zeros(100)
    pulse[:12] = np.round(5.0 * np.sin(np.pi * np.arange(12) / 12.0))
    u, y = np.tile(pulse, 5), np.tile(np.roll(pulse, 3), 5)
    record = seen(u, y, LogSegment("record", 0, u.size, {"period_samples": 100}))
    assert of(record, "ended") == [] == of(record, "clipping")


def test_a_slow_input_makes_no_slow_sensor():
    levels = np.repeat(np.random.default_rng(1).integers(-50, 50, 300), 10).astype(float)
    assert of(seen(levels, 2.0 * levels), "slow-sensor") == []


def test_a_period_is_not_cut_by_an_end_within_it(tmp_path):
    u, y = plain()
    u[2980:], y[2980:] = 0.0, 0.0
    channels = [Channel("u", "N m", "input", "a", RATE_HZ), Channel("y", "rad", "output", "a", RATE_HZ)]
    with (
        LogWriter.create(tmp_path / "a.h5", channels, test="t", bench={"kind": "imported", "name": "n"}) as log,
        log.segment("record", {"period_samples": 500}),
    ):
        log.append({"u": u, "y": y})
    with read_run(tmp_path / "a.h5") as run:
        assert [(s.start, s.stop) for s in usable_segments(run)] == [(0, 2500)]


def test_a_log_in_which_nothing_moves_is_refused(tmp_path):
    channels = [Channel("u", "N m", "input", "a", RATE_HZ), Channel("y", "rad", "output", "a", RATE_HZ)]
    with LogWriter.create(tmp_path / "a.h5", channels, test="t", bench={"kind": "imported", "name": "n"}) as log:
        for level in (0.0, 1.0):
            with log.segment(f"level {level}", {}):
                log.append({"u": np.arange(100.0), "y": np.full(100, level)})
    with read_run(tmp_path / "a.h5") as run, pytest.raises(DataError, match="no output moves in any segment"):
        usable_segments(run)


def test_facts_of_a_part_of_a_log_say_nothing_of_its_end(tmp_path, monkeypatch):
    u, y = plain()
    u[900:1000], y[900:1000] = 0.0, 0.0
    channels = [Channel("u", "N m", "input", "a", RATE_HZ), Channel("y", "rad", "output", "a", RATE_HZ)]
    with (
        LogWriter.create(tmp_path / "a.h5", channels, test="t", bench={"kind": "imported", "name": "n"}) as log,
        log.segment("record", {}),
    ):
        log.append({"u": u, "y": y})
    monkeypatch.setattr(campaigns.facts.finding, "MOST_NUMBERS", 2000)
    with read_run(tmp_path / "a.h5") as run:
        assert {fact.name for fact in facts_of(run)} & {"ended", "at-rest"} == set()


def test_a_sensor_that_is_slower_than_the_log_but_faster_than_the_steps_played_is_told():
    levels = np.repeat(np.random.default_rng(1).standard_normal(75), 40)
    swing = np.convolve(levels, np.exp(-np.arange(300) / 60.0))[: levels.size]
    (fact,) = of(seen(levels, swing[(np.arange(swing.size) // 4) * 4]), "slow-sensor")
    assert fact.numbers["every"] == 4
