"""Every benchmark with small sizes: all contenders compute the same. Times are not asserted, they are the machine's."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from benchmarks.__main__ import main
from benchmarks.speed import BENCHMARKS
from benchmarks.speed.base import (
    Agreement,
    Benchmark,
    Contender,
    Prepared,
    Round,
    Target,
    at_most_seconds,
    times_faster,
    times_the_time,
)
from benchmarks.speed.machine import doubt, load, machine, sources
from benchmarks.speed.measure import measure
from benchmarks.speed.report import markdown


@pytest.mark.parametrize("benchmark", BENCHMARKS, ids=lambda b: b.name)
def test_all_compute_the_same(benchmark: Benchmark) -> None:
    found = measure(benchmark, rounds=1, quick=True)
    wrong = [a for a in found["agreements"] if not a["holds"]]
    assert wrong == []
    # whoever takes part is compared, but for the one that the others are compared with
    assert len({a["name"] for a in found["agreements"]} & set(found["contenders"])) >= len(found["contenders"]) - 1
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize("benchmark", BENCHMARKS, ids=lambda b: b.name)
def test_what_is_missed_speaks_of_a_target(benchmark: Benchmark) -> None:
    assert set(benchmark.missed) <= {target.what for target in benchmark.targets}


def test_the_names_are_distinct() -> None:
    assert len({b.name for b in BENCHMARKS}) == len(BENCHMARKS)


class Clock:
    """Time that passes only where a contender lets it pass."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def made_up(clock: Clock, *targets: Target, wrong: float = 0.0) -> Benchmark:
    """Ours takes 1, 2, 3 … s for 10 units from run to run, the peer always 4 s for 2 units and runs twice."""
    order: list[str] = []

    def ours() -> int:
        order.append("ours")
        clock.now_s += order.count("ours")
        return 7

    def peer() -> int:
        order.append("peer")
        clock.now_s += 4.0
        return 7

    def prepare(quick: bool, folder: Path) -> Prepared:
        assert folder.is_dir()
        contenders = (Contender("ours", ours, 10.0, warm=0), Contender("peer", peer, 2.0, rounds=2, warm=0))
        return Prepared(
            contenders,
            lambda results: [Agreement("peer", abs(results["ours"] - results["peer"]) + wrong, 0.5, "made up")],
            {"other": "not installed"},
            {"order": order},
        )

    return Benchmark("made-up", "nothing", prepare, targets, {"ours: times as fast as peer": "it dawdles"})


def ran(dirty: bool | None) -> dict[str, Any]:
    """Return what a results file says besides its benchmarks."""
    mccd = {"version": "1.0", "commit": "unknown" if dirty is None else "abc1234", "dirty": dirty}
    told = {"command": "", "started_utc": "", "ended_utc": "", "benchmarks": []}
    return {"mccd": mccd, "machine": machine(), "load": {"start": [1.0, 2.0, 3.0], "end": None}, **told}


def test_numbers_are_taken_round_by_round_and_per_unit() -> None:
    clock = Clock()
    above = Target("above", 0.0, "s", ("ours", "peer"), lambda turn: turn.seconds["ours"] - turn.seconds["peer"], True)
    targets = (times_faster("ours", "peer", 15.0), times_the_time("ours", "peer", 0.1), at_most_seconds("ours", 0.2))
    found = measure(made_up(clock, *targets, above), rounds=3, quick=True, clock=clock)
    faster, ratio, seconds, difference = found["targets"]
    # seconds per unit of ours: 0.1, 0.2, 0.3; of the peer: 2, 2
    assert (faster["lowest"], faster["median"], faster["highest"], faster["rounds"]) == pytest.approx((10, 15, 20, 2))
    assert faster["reached"] is True and "why" not in faster
    assert ratio["median"] == pytest.approx(0.075) and ratio["reached"] is True
    assert seconds["median"] == pytest.approx(0.2) and seconds["rounds"] == 3
    assert difference["median"] == pytest.approx(-1.85)
    # the one who begins changes
    assert found["facts"]["order"] == ["ours", "peer", "peer", "ours", "ours"]


def test_a_missed_target_says_why_and_shows_a_profile() -> None:
    clock = Clock()
    found = measure(made_up(clock, times_faster("ours", "peer", 1000.0)), rounds=2, quick=False, clock=clock)
    (target,) = found["targets"]
    assert target["reached"] is False and target["why"] == "it dawdles"
    assert len(found["profiles"]["ours"]) > 0
    table = markdown({**ran(dirty=False), "benchmarks": [found]})
    assert "**no**" in table and "it dawdles" in table and "other is absent: not installed" in table


def test_a_target_without_its_peer_is_not_measured() -> None:
    clock = Clock()
    found = measure(made_up(clock, times_faster("ours", "other", 10.0)), rounds=1, quick=True, clock=clock)
    assert found["targets"][0]["reached"] is None and "not installed" in found["targets"][0]["why"]


def test_a_number_that_nobody_tells_is_not_measured() -> None:
    clock = Clock()
    untold = Target("untold", 1.0, "%", ("ours",), lambda turn: float("nan"))
    found = measure(made_up(clock, untold), rounds=1, quick=True, clock=clock)
    assert found["targets"][0]["reached"] is None and "nothing here tells" in found["targets"][0]["why"]
    json.dumps(found, allow_nan=False)


@pytest.mark.parametrize(("error", "holds"), [(0.9, True), (1.1, False), (float("nan"), False)])
def test_an_error_that_is_no_number_is_not_allowed(error: float, holds: bool) -> None:
    assert Agreement("a", error, 1.0, "").holds is holds


def test_the_limit_itself_is_reached() -> None:
    turn = Round({"a": 1.0, "b": 3.0}, {})
    faster, slower = times_faster("a", "b", 3.0), times_the_time("a", "b", 0.333)
    assert faster.reached(faster.value(turn)) and not slower.reached(slower.value(turn))


def test_the_command_writes_table_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = BENCHMARKS[0].name
    assert main([name, "--quick", "--out", str(tmp_path)]) == 0
    (written,) = tmp_path.glob("*.json")
    found = json.loads(written.read_text(encoding="utf-8"))
    assert [row["name"] for row in found["benchmarks"]] == [name] and found["quick"] is True
    assert written.with_suffix(".md").read_text(encoding="utf-8") == markdown(found)
    assert f"| {name} |" in capsys.readouterr().out


def test_a_result_says_what_it_was_measured_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.__main__.BENCHMARKS", (made_up(Clock()),))
    monkeypatch.setattr("benchmarks.speed.machine.tool_commit", lambda: "abc1234-dirty")
    assert main(["--quick", "--out", str(tmp_path)]) == 0
    found = json.loads(next(tmp_path.glob("*.json")).read_text(encoding="utf-8"))
    assert (found["mccd"]["commit"], found["mccd"]["dirty"]) == ("abc1234", True)
    assert found["machine"]["cores"] == os.cpu_count()
    for name in ("gcc", "numpy", "scipy", "numba"):
        assert f"{name} {found['machine'][name]}" in markdown(found)
    assert set(found["load"]) == {"start", "end"} and (load() is None or len(found["load"]["end"]) == 3)


@pytest.mark.parametrize(
    ("dirty", "said"), [(True, "tree was dirty"), (None, "commit is unknown"), (False, "commit abc1234.\n")]
)
def test_sources_that_nobody_can_fetch_are_marked(dirty: bool | None, said: str) -> None:
    table = markdown(ran(dirty))
    assert said in table and ("**" in table) is (dirty is not False)
    assert "at the start 1 2 3, at the end unknown" in table


@pytest.mark.parametrize(
    ("told", "commit", "dirty"), [("ab12", "ab12", False), ("ab12-dirty", "ab12", True), ("unknown", "unknown", None)]
)
def test_a_commit_is_told_apart_from_its_state(
    told: str, commit: str, dirty: bool | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.speed.machine.tool_commit", lambda: told)
    found = sources()
    assert (found["commit"], found["dirty"]) == (commit, dirty)
    assert (doubt(found) is None) is (dirty is False)


def test_results_that_differ_fail_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("benchmarks.__main__.BENCHMARKS", (made_up(Clock(), wrong=1.0),))
    assert main(["--quick", "--out", str(tmp_path)]) == 1


@pytest.mark.parametrize(("words", "said"), [(["none"], "no benchmark 'none'"), (["--rounds", "0"], "at least 1")])
def test_what_cannot_be_run_is_refused(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(words)
    assert stopped.value.code == 2 and said in capsys.readouterr().err


def test_the_list_names_every_benchmark(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    assert [line.split(":")[0] for line in capsys.readouterr().out.splitlines()] == [b.name for b in BENCHMARKS]
