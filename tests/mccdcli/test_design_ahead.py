"""The process that designs while a campaign plays: when it begins, that it ends, and that it may fail."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from campaigns.playing.campaign import Campaign, load_campaign
from campaigns.playing.campaign_run import RunState
from mccdcli import design_ahead
from mccdcli.design_ahead import DesignAhead

RUNS = """
schema = "mccd-campaign/1"
name = "short"
[[runs]]
name = "rest"
plan = "rest"
[[runs]]
name = "sweep"
plan = "sinesweep"
[[runs]]
name = "cold"
plan = "sinesweep"
settings = { cold_finger_k = 77.0 }
[[runs]]
name = "chop"
plan = "chop"
"""


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    (tmp_path / "short.toml").write_text(RUNS)
    return load_campaign(str(tmp_path / "short.toml"))


def states(folder: Path, *complete: str) -> dict[str, RunState]:
    """Return the state of every run; what is complete has a log that is none."""
    found = {}
    for name in ("rest", "sweep", "cold", "chop"):
        log = folder / f"{name}.h5"
        log.write_bytes(b"no log")
        found[name] = RunState(name, "", log, 0, "", status="complete" if name in complete else "missing")
    return found


def test_it_begins_once_and_only_when_all_that_it_chooses_from_is_there(campaign, tmp_path, monkeypatch):
    monkeypatch.setattr("campaigns.playing.side_by_side.free_cores", lambda: 2)
    begun: list[list[Path]] = []
    monkeypatch.setattr(DesignAhead, "_begin", lambda self, logs: begun.append(logs))
    with DesignAhead(campaign, "sim", 0, tmp_path) as ahead:
        ahead.begin(states(tmp_path))
        ahead.begin(states(tmp_path, "rest", "chop", "cold"))
        assert not begun
        ahead.begin(states(tmp_path, "rest", "sweep"))
    assert begun == [[tmp_path / "rest.h5", tmp_path / "sweep.h5"]]


@pytest.mark.parametrize("why", ["a controller is there", "one core", "a bench of which there is one"])
def test_it_does_not_begin_where_nothing_is_gained(why, campaign, tmp_path, monkeypatch):
    cores = 1 if why == "one core" else 2
    monkeypatch.setattr("campaigns.playing.side_by_side.free_cores", lambda: cores)
    if why == "a controller is there":
        (tmp_path / "controller.toml").write_text("")
    bench = "serial:/dev/null" if why == "a bench of which there is one" else "sim"
    with DesignAhead(campaign, bench, 0, tmp_path) as ahead:
        ahead.begin(states(tmp_path, "rest", "sweep"))
        assert ahead.process is None
        ahead.finish()


def test_logs_that_it_cannot_read_leave_the_design_to_the_campaigns_end(campaign, tmp_path, monkeypatch):
    monkeypatch.setattr("campaigns.playing.side_by_side.free_cores", lambda: 2)
    with DesignAhead(campaign, "sim", 0, tmp_path / "out") as ahead:
        ahead.begin(states(tmp_path, "rest", "sweep"))
        ahead.finish()
        assert ahead.process is not None and ahead.process.returncode == 1
    assert not (tmp_path / "out").exists()


def test_it_ends_with_the_campaign_that_is_left(campaign, tmp_path, monkeypatch):
    monkeypatch.setattr("campaigns.playing.side_by_side.free_cores", lambda: 2)
    monkeypatch.setattr(design_ahead, "_CHILD", "import time; time.sleep(600)")
    with DesignAhead(campaign, "sim", 0, tmp_path) as ahead:
        ahead.begin(states(tmp_path, "rest", "sweep"))
        assert ahead.process is not None and ahead.process.poll() is None
    assert ahead.process.returncode is not None


def test_a_machine_that_can_begin_no_process_plays_on(campaign, tmp_path, monkeypatch):
    monkeypatch.setattr("campaigns.playing.side_by_side.free_cores", lambda: 2)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "no-python"))
    with DesignAhead(campaign, "sim", 0, tmp_path) as ahead:
        ahead.begin(states(tmp_path, "rest", "sweep"))
        assert ahead.process is None
        ahead.finish()
