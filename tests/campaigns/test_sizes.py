"""Plans without end are refused with their size before memory is taken, by a run and by a dry run alike."""

from __future__ import annotations

import resource
from pathlib import Path
from typing import Any

import pytest

from analysis.challenge.make import Counts, plans_of
from analysis.challenge.second import make as second
from analysis.study.definition import parse_study
from campaigns import sizes
from campaigns.plans import estimate, make_plan
from campaigns.playing.campaign import parse_campaign
from campaigns.playing.counting import estimate_campaign
from campaigns.sizes import MOST_RUNS
from sim_backend.errors import ConfigError
from sim_backend.model import load_model
from sim_backend.simbench import SimBench
from tests.running import mccd

ENDLESS: list[tuple[str, dict[str, Any], str]] = [
    ("chop", {"cycles": 10**9}, "5.556e.05 h"),
    ("chop", {"frequency_hz": 1e-300, "window_s": 1.0}, "1e.300 s"),
    ("settling", {"cycles": 2**62}, "9.6e.* h|2.562e.14 h"),
    ("thermal", {"cycles": 10**9}, "5.556e.04 h"),
    ("rest", {"duration_s": 1e308}, "1.798e.304 s"),
    ("rest", {"duration_s": 1e6}, "the limit is 3355 s"),
    ("endstops", {"hold_s": 1e6}, "the limit is 3355 s"),
    ("endstops", {"ramp_s": 1e308}, "1.798e.304 s"),
    ("freerun", {"steps_s": 1e7}, "1e.07 s"),
    ("freerun", {"move_s": 1e300}, "1e.300 s"),
    ("hysteresis", {"frequency_hz": 1e-300}, "1e.300 s"),
    ("hysteresis", {"frequency_hz": 4e-4}, "the limit is 419.4 s"),
    ("hysteresis", {"repeats": 10**9}, "steps"),
    ("hysteresis", {"cycles": 10**8}, "4.167e.05 h"),
    ("hysteresis", {"cycles": 10**4}, "at once"),
    ("multisine", {"realisations": 10**9}, "2.5e.06 h"),
    ("multisine", {"periods": 10**4}, "at once"),
    ("multisine", {"period_s": 3000.0, "realisations": 1}, "the limit is 419.4 s"),
    ("chop", {"frequency_hz": 4e-4}, "the limit is 419.4 s"),
    ("endstops", {"ramp_s": 3300.0}, "the limit is 419.4 s"),
    ("freerun", {"noise_s": 3300.0, "steps_s": 3300.0}, "the limit is 419.4 s"),
    ("freerun", {"move_s": 1e-300, "dwell_s": 1e-300, "steps_s": 400.0}, "dwell_s"),
    ("multisine", {"period_s": 1e9}, "1e.09 s"),
    ("sinesweep", {"bands": [{"start_hz": 5.0, "stop_hz": 100.0, "step_hz": 1e-9}]}, "9.5e.10 steps"),
    ("sinesweep", {"bands": [{"start_hz": 5.0, "stop_hz": 6.0, "step_hz": 1.0, "settle_s": 1e300}]}, "h, "),
    ("theodolite", {"settle_s": 1e12}, "1e.12 s"),
    ("chop", {"tuning": {"move_s": 1e300}}, "1e.300 s|profile|move"),
]


@pytest.mark.parametrize(("name", "settings", "words"), ENDLESS, ids=lambda v: str(v)[:40])
def test_a_plan_without_end_is_refused_with_its_size(name: str, settings: dict[str, Any], words: str) -> None:
    bench = SimBench(load_model("as-built"), 1)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ConfigError, match=words):
        estimate(make_plan(name, settings), bench)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB: nothing of that size was made


def test_a_run_and_a_dry_run_refuse_alike(tmp_path: Path) -> None:
    words = ("chop", "--cycles", "1000000000", "-o", "chop.h5")
    told = [mccd(*words, *more, cwd=tmp_path) for more in ((), ("--dry-run",))]
    assert [one.returncode for one in told] == [2, 2]
    assert told[0].stderr == told[1].stderr
    assert "5.556e+05 h" in told[0].stderr and "a run may take 100 h" in told[0].stderr
    assert list(tmp_path.iterdir()) == []


def _campaign(runs: int, cycles: int) -> str:
    one = '[[runs]]\nname = "r{}"\nplan = "thermal"\nsettings = {{ cycles = {} }}\n'
    return 'name = "long"\n' + "".join(one.format(i, cycles) for i in range(runs))


def test_a_campaign_of_too_many_runs_or_hours_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ConfigError, match=f"20000 runs; a campaign has {MOST_RUNS} at most"):
        parse_campaign(_campaign(20_000, 1), "here")
    monkeypatch.setattr(sizes, "MOST_IN_CAMPAIGN_H", 1.0)
    with pytest.raises(ConfigError, match="campaign 'long' would take 1.1.* h and .* GB; the limit is 1 h"):
        estimate_campaign(parse_campaign(_campaign(10, 2000), "here"), "sim", 1)


def test_a_study_of_too_many_trials_is_refused() -> None:
    text = 'schema = "mccd-study/1"\nname = "n"\nkind = "rest"\n'
    with pytest.raises(ConfigError, match="give 1 to 10000000"):
        parse_study(f"{text}trials = 1000000000000", "here")
    sweep = f'trials = 9000000\n[[vary]]\nplace = "settings.a"\nsweep = {list(range(1000))}'
    with pytest.raises(ConfigError, match="9000000000 trials, the limit is 10000000"):
        parse_study(text + sweep, "here")


def test_a_challenge_of_too_many_cases_is_refused() -> None:
    with pytest.raises(ConfigError, match="cases, .* h and .* GB or more; the limit is 100000"):
        plans_of(Counts(one=10**9), ("backlash",), None)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="the limit is 100000"):
        second.plans_of(second.Counts(none=10**9), (), None)  # type: ignore[arg-type]


@pytest.mark.parametrize("asked", [{"two": 10**9}, {"outside": 10**9}])
def test_a_challenge_without_end_is_refused_before_anything_is_computed(
    monkeypatch: pytest.MonkeyPatch, asked: dict[str, int]
) -> None:
    monkeypatch.setattr("analysis.challenge.make.separable", lambda *_: pytest.fail("it was computed"))
    with pytest.raises(ConfigError, match="the limit is 100000"):
        plans_of(Counts(none=0, one=0, **asked), ("delay",), None)  # type: ignore[arg-type]
