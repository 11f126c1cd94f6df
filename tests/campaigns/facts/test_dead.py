"""Channels that never change are told, in a log of any origin, with what identification and diagnosis make of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.identification.identify import identify_runs
from campaigns.facts import Fact, Seen, dead_in_all, facts_of, found_in, usable_segments
from campaigns.facts.dead import NAME
from campaigns.log import Channel, LogSegment, LogWriter, Run, read_run
from sim_backend.errors import DataError
from tests.campaigns.facts import drawn

ROWS = 3000


def moving(seed: int) -> np.ndarray:
    """Return two inputs and the outputs that they move, (n, 4)."""
    rng = np.random.default_rng(seed)
    bench = drawn.Bench(np.array([0.3]), np.array([0.1]), np.ones(1), 0, 0.01, 0.0, 0.0, 0.0)
    each = [rng.standard_normal(ROWS) for _ in range(2)]
    return np.stack([*each, *(drawn.played(bench, u, rng)[1] for u in each)], axis=1)


def told(values: np.ndarray, **more: bool) -> list[Fact]:
    record = drawn.seen(values[:, :2], values[:, 2:])
    record = Seen(record.columns, record.channels, record.segments, record.rate_hz, **more)
    return [fact for fact in found_in(record, ()) if fact.name == NAME]


def written(path: Path, values: np.ndarray) -> Path:
    """Write a log as a campaign does, without facts."""
    names = {"i0": "input", "i1": "input", "o0": "output", "o1": "output"}
    units = {"input": "N m", "output": "rad"}
    channels = [Channel(name, units[role], role, f"a{name[1]}", drawn.RATE_HZ) for name, role in names.items()]
    with (
        LogWriter.create(path, channels, test="t", bench={"kind": "sim", "name": "n"}) as log,
        log.segment("record", {}),
    ):
        log.append(dict(zip(names, values.T, strict=True)))
    return path


def test_channels_that_move_are_not_told() -> None:
    assert told(moving(1)) == []


def test_one_dead_output_of_two_is_remarked_and_the_log_is_not_forbidden() -> None:
    values = moving(2)
    values[:, 3] = 0.25
    (fact,) = told(values)
    assert (fact.channel, fact.numbers["value"], fact.remark, fact.forbids) == ("o1", 0.25, True, False)
    assert "output 'o1' is constant at 0.25 rad in all 3000 samples" in fact.finding


def test_a_dead_input_is_told_when_asked_for_only() -> None:
    values = moving(3)
    values[:, 1] = 0.0
    (fact,) = told(values)
    assert (fact.channel, fact.remark, fact.forbids) == ("i1", False, False)


def test_a_log_in_which_no_output_changes_is_forbidden(tmp_path) -> None:
    values = moving(4)
    values[:, 2:] = 0.0
    assert [fact.forbids for fact in told(values)] == [True, True]
    with (
        read_run(written(tmp_path / "a.h5", values)) as run,
        pytest.raises(DataError, match=r"output 'o0' is constant at 0 rad .*no output changes"),
    ):
        usable_segments(run)


def test_what_was_not_read_to_its_end_may_move_later() -> None:
    values = moving(5)
    values[:, 3] = 0.0
    assert told(values, complete=False) == []


def test_a_channel_without_any_number_is_missing_and_not_constant() -> None:
    values = moving(6)
    values[:, 3] = np.nan
    record = drawn.seen(values[:, :2], values[:, 2:])
    found = found_in(record)
    assert [fact.name for fact in found if fact.channel == "o1"] == ["missing"]
    every = Seen({"o0": values[:, 3]}, {"o0": record.channels["o0"]}, [LogSegment("r", 0, ROWS, {})], record.rate_hz)
    assert [fact.name for fact in found_in(every)] == ["missing"]


def identified(*runs: Run) -> tuple[str, ...]:
    return identify_runs(runs, modes=2).remarks


def test_identification_refuses_a_dead_output_and_remarks_a_dead_input(tmp_path) -> None:
    sound, deaf, undriven = moving(7), moving(8), moving(9)
    deaf[:, 3], undriven[:, 1] = 0.25, 0.0
    paths = [written(tmp_path / f"{k}.h5", values) for k, values in enumerate((sound, deaf, undriven))]
    with read_run(paths[0]) as whole, read_run(paths[1]) as no_output, read_run(paths[2]) as no_input:
        with pytest.raises(DataError, match=r"1\.h5: output 'o1' is constant at 0\.25 rad in all 3000 samples"):
            identified(no_output)
        assert any("input i1 moves in no log" in remark for remark in identified(no_input))
        assert not any("moves in no log" in remark for remark in identified(no_input, whole))
        assert dead_in_all([facts_of(no_output), facts_of(whole)]) == ()
