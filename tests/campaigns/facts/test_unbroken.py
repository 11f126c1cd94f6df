"""One recording that was cut into segments is known by its motion, which goes on; those made one by one are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from campaigns.facts import Fact, Seen, found_in, unbroken
from campaigns.log import LogSegment
from tests.campaigns.facts import drawn

ROWS = 3000


def recording(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A drawn bench is driven by noise."""
    return drawn.played(drawn.drawn_bench(rng, linear=True), rng.standard_normal(2 * ROWS), rng)


def joined(parts: list[tuple[np.ndarray, np.ndarray]], period: int = 0) -> Seen:
    """One log of the parts, each a segment."""
    u, y = (np.concatenate([part[k] for part in parts]) for k in (0, 1))
    ends = np.cumsum([part[0].shape[0] for part in parts])
    settings = {"period_samples": period} if period else {}
    segments = [
        LogSegment(f"part {k}", int(e - p[0].shape[0]), int(e), settings)
        for k, (e, p) in enumerate(zip(ends, parts, strict=True))
    ]
    return replace(drawn.seen(u, y), segments=segments)


def told(record: Seen) -> list[Fact]:
    return [fact for fact in found_in(record, [unbroken.NAME]) if fact.name == unbroken.NAME]


def cut(u: np.ndarray, y: np.ndarray, at: int = ROWS) -> list[tuple[np.ndarray, np.ndarray]]:
    return [(u[:at], y[:at]), (u[at:], y[at:])]


def test_a_recording_that_was_cut_is_mostly_found():
    """Two of three, in noise of 0.1 to 1 % of the motion: a cut may fall where the motion turns or the bench rests."""
    found = 0
    for case in range(60):
        rng = np.random.default_rng([201, case])
        bench = replace(drawn.drawn_bench(rng, linear=True), noise=10.0 ** rng.uniform(-3.0, -2.0), colour=0.0)
        kind = str(rng.choice(["white", "coloured", "steps", "chirp", "multisine"]))
        (fact,) = told(joined(cut(*drawn.played(bench, drawn.excitation(rng, kind, 2 * ROWS)[0], rng))))
        assert not fact.remark and fact.segment == "part 1" and fact.numbers["start"] == ROWS
        found += bool(fact.numbers["found"])
    assert found >= 40, found


@pytest.mark.parametrize("part", range(4))
def test_recordings_of_their_own_fit_together_as_often_as_is_said(part):
    """At most one in a hundred, of every kind of drawn bench; of 100, more than four have a chance of 0.3 %."""
    wrong = []
    for case in range(part, 400, 4):
        rng = np.random.default_rng([202, case])
        axes = int(rng.choice([1, 3]))
        benches = [drawn.drawn_bench(rng) for _ in range(axes)]
        kind = str(rng.choice(["white", "coloured", "steps", "chirp", "multisine"]))
        # each begins in a motion of its own, or at rest
        lead, parts = int(rng.integers(500, 2000)) * int(rng.integers(0, 2)), []
        for _ in range(2):
            motions = [drawn.played(one, drawn.excitation(rng, kind, lead + 1000)[0], rng) for one in benches]
            u, y = (np.stack([motion[k] for motion in motions], axis=1)[lead:] for k in (0, 1))
            parts.append((u, y))
        if told(joined(parts))[0].numbers["found"]:
            wrong.append(case)
    assert len(wrong) <= 4, wrong


def test_each_border_is_told_by_itself():
    rng = np.random.default_rng(203)
    first, other = (drawn.played(quiet(0.1), rng.standard_normal(2 * ROWS), rng) for _ in range(2))
    parts = [*cut(*first), cut(*other)[1]]
    assert [fact.numbers["found"] for fact in told(joined(parts))] == [1.0, 0.0]


def quiet(damping: float = 0.3) -> drawn.Bench:
    """A bench of one mode in little noise, at rest within some hundred rows."""
    return drawn.Bench(np.array([0.1]), np.array([damping]), np.ones(1), 0, 1e-3, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("lead", "tail"), [(0, 0), (0, 600), (600, 0), (600, 600)])
@pytest.mark.parametrize("noisy_axis", [False, True])
def test_what_rests_at_a_border_tells_nothing(lead, tail, noisy_axis):
    """At the end of one recording, at the start of the next, or both: a bench at rest looks alike in any of them.

    Nor does an axis that nothing drives, which is as noisy everywhere.
    """
    wrong = 0
    for case in range(20):
        rng, parts = np.random.default_rng([204, case]), []
        for rest in ((0, tail), (lead, 0)):
            u = rng.standard_normal(ROWS)
            u[: rest[0]] = 0.0
            u[ROWS - rest[1] :] = 0.0
            u, y = drawn.played(quiet(), u, rng)
            parts.append((u, np.stack([y, rng.standard_normal(ROWS)], axis=1) if noisy_axis else y))
        wrong += bool(told(joined(parts))[0].numbers["found"])
    assert wrong <= 1, wrong


def test_one_axis_after_the_other_may_have_been_recorded_in_any_order():
    wrong = 0
    for case in range(20):
        rng, parts = np.random.default_rng([205, case]), []
        for axis in range(2):
            u, y = np.zeros((ROWS, 2)), 1e-3 * rng.standard_normal((ROWS, 2))
            u[: ROWS - 600, axis] = rng.standard_normal(ROWS - 600)
            y[:, axis] = drawn.played(quiet(), u[:, axis], rng)[1]
            parts.append((u, y))
        wrong += bool(told(joined(parts))[0].numbers["found"])
    assert wrong <= 1, wrong


@pytest.mark.parametrize(
    ("period", "claimed", "noise", "level"),
    [
        (500, True, 0.0, 1.0),
        (500, True, 0.03, 1.0),
        (500, False, 0.0, 1.0),
        (500, True, 0.0, 1.1),
        (10_000, True, 0.0, 1.0),
    ],
)
def test_what_is_played_again_fits_together_in_any_case(period, claimed, noise, level):
    """Both recordings have come to repeat: a motion at the start of a period follows one at its end."""
    for case in range(5):
        rng = np.random.default_rng([206, case])
        wave, parts = rng.standard_normal(period), []
        for size in (1.0, level):
            u, y = drawn.played(quiet(), size * np.tile(wave, 4), rng)
            parts.append(((u + noise * rng.standard_normal(u.size))[period:], y[period:]))
        assert not told(joined(parts, period if claimed else 0))[0].numbers["found"]


def test_a_drift_that_recordings_share_does_not_make_one_of_them():
    wrong = 0
    for case in range(20):
        rng = np.random.default_rng([207, case])
        u, y = drawn.played(quiet(), rng.standard_normal(2 * ROWS + 500), rng)
        y += 30.0 * y.std() * np.linspace(-1.0, 1.0, y.size)
        wrong += bool(told(joined([(u[:ROWS], y[:ROWS]), (u[ROWS + 500 :], y[ROWS + 500 :])]))[0].numbers["found"])
    assert wrong <= 1, wrong


@pytest.mark.parametrize("rows", [200, 210, 300])
def test_short_segments_and_readings_that_rest_tell_nothing(rows):
    u, y = recording(np.random.default_rng(208))
    told(joined([(u[:ROWS], y[:ROWS]), (u[ROWS : ROWS + rows], y[ROWS : ROWS + rows])]))  # either way
    still = np.where(np.arange(2 * ROWS) < ROWS, y, y[ROWS])
    assert told(joined(cut(u, still))) == []
    assert told(joined([(u[:ROWS], y[:ROWS]), (u[ROWS : ROWS + 20], y[ROWS : ROWS + 20])])) == []


def test_where_readings_are_missing_nothing_is_told():
    """Lines are drawn over them, which go on in any case."""
    u, y = recording(np.random.default_rng(209))
    y[100:110] = np.nan
    assert [fact.numbers["chance"] for fact in told(joined(cut(u, y)))] == [1.0]


def test_rows_between_segments_and_a_single_segment_are_not_asked():
    u, y = recording(np.random.default_rng(207))
    record = joined(cut(u, y))
    apart = [record.segments[0], replace(record.segments[1], start=ROWS + 10)]
    assert told(replace(record, segments=apart)) == [] and told(drawn.seen(u, y)) == []
