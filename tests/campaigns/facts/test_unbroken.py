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
    ends = np.cumsum([part[0].size for part in parts])
    settings = {"period_samples": period} if period else {}
    segments = [
        LogSegment(f"part {k}", int(e - p[0].size), int(e), settings)
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


def test_recordings_of_their_own_fit_together_as_often_as_is_said():
    """At most one in a hundred; of 400, more than ten have a chance of 0.3 %."""
    wrong = []
    for case in range(400):
        rng = np.random.default_rng([202, case])
        bench, kind = drawn.drawn_bench(rng, linear=True), str(rng.choice(["white", "coloured", "chirp", "multisine"]))
        lead = int(rng.integers(500, 2000))  # each begins in a motion of its own
        parts = []
        for _ in range(2):
            u, y = drawn.played(bench, drawn.excitation(rng, kind, lead + 1000)[0], rng)
            parts.append((u[lead:], y[lead:]))
        if told(joined(parts))[0].numbers["found"]:
            wrong.append(case)
    assert len(wrong) <= 10, wrong


def test_each_border_is_told_by_itself():
    rng = np.random.default_rng(203)
    bench = drawn.Bench(np.array([0.1]), np.array([0.1]), np.ones(1), 0, 1e-3, 0.0, 0.0, 0.0)
    first, other = (drawn.played(bench, rng.standard_normal(2 * ROWS), rng) for _ in range(2))
    parts = [*cut(*first), cut(*other)[1]]
    assert [fact.numbers["found"] for fact in told(joined(parts))] == [1.0, 0.0]


@pytest.mark.parametrize("side", [0, 1])
def test_what_rests_at_a_border_tells_nothing(side):
    """A bench that has come to rest looks alike at the end of any recording, and one that is at rest at its start."""
    rng = np.random.default_rng(204)
    bench = drawn.Bench(np.array([0.1]), np.array([0.3]), np.ones(1), 0, 1e-3, 0.0, 0.0, 0.0)
    u = rng.standard_normal(2 * ROWS)
    u[ROWS - 600 * (1 - side) : ROWS + 600 * side] = 0.0
    u, y = drawn.played(bench, u, rng)
    if side == 1:  # the first part moves until its end, where it is at zero by chance
        y[ROWS:] -= y[ROWS] - y[ROWS - 1]
    (fact,) = told(joined(cut(u, y)))
    assert not fact.numbers["found"] and "cannot be told" in fact.finding


def test_periods_that_repeat_fit_together_in_any_case():
    rng = np.random.default_rng(205)
    bench = drawn.Bench(np.array([0.1]), np.array([0.1]), np.ones(1), 0, 1e-3, 0.0, 0.0, 0.0)
    u = np.tile(rng.standard_normal(500), 14)
    parts = []
    for _ in range(2):  # both have come to repeat before they were recorded
        one = drawn.played(bench, u, rng)
        parts.append((one[0][1000:], one[1][1000:]))
    assert not told(joined(parts, 500))[0].numbers["found"]
    assert told(joined(parts))[0].numbers["found"]  # without the word that they repeat it looks like one


@pytest.mark.parametrize("rows", [0, 1, 5, 20])
def test_short_segments_and_constant_readings_tell_nothing(rows):
    u, y = recording(np.random.default_rng(206))
    parts = [(u[:ROWS], y[:ROWS]), (u[ROWS : ROWS + rows], y[ROWS : ROWS + rows])]
    assert not any(fact.numbers["found"] for fact in told(joined(parts)))
    assert not any(fact.numbers["found"] for fact in told(joined(cut(u, np.zeros_like(y)))))


def test_rows_between_segments_and_a_single_segment_are_not_asked():
    u, y = recording(np.random.default_rng(207))
    record = joined(cut(u, y))
    apart = [record.segments[0], replace(record.segments[1], start=ROWS + 10)]
    assert told(replace(record, segments=apart)) == [] and told(drawn.seen(u, y)) == []
