"""Campaigns: resumed equals uninterrupted bit for bit, nothing is repeated, nothing is overwritten."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import campaigns.benches
from campaigns.benches import BenchKind, open_bench
from campaigns.log import probe, read_run, verify
from campaigns.playing.campaign import bundled_campaigns, load_campaign, parse_campaign, run_seed
from campaigns.playing.campaign_run import read_state, run_campaign
from campaigns.playing.counting import estimate_campaign
from sim_backend.errors import ConfigError, DataError
from sim_backend.model import dump_model
from sim_backend.simbench import SimBench
from tests.small_bench import NOISE, bench_model

ROOT = Path(__file__).parents[3]

CAMPAIGN = """
schema = "mccd-campaign/1"
name = "three"

[[runs]]
name = "stops"
plan = "endstops"
settings = { ramp_s = 0.02, settle_s = 0.02, hold_s = 0.02 }

[[runs]]
name = "chop"
plan = "chop"
settings = { cycles = 2, frequency_hz = 2.0, window_s = 0.1, model = "design.toml" }

[[runs]]
name = "sines"
plan = "sinesweep"
settings = { bands = [{ start_hz = 10.0, stop_hz = 60.0, step_hz = 10.0, settle_s = 0.1 }] }
"""


@pytest.fixture
def file(tmp_path):
    (tmp_path / "design.toml").write_text(dump_model(bench_model(hardware=False)), encoding="utf-8")
    path = tmp_path / "three.toml"
    path.write_text(CAMPAIGN, encoding="utf-8")
    return path


@pytest.fixture(autouse=True)
def small(monkeypatch):
    def opened(_address, seed, disturbance):
        return SimBench(bench_model(NOISE), seed, disturbance=disturbance)

    kind = BenchKind("small", "", opened, lambda _address: "small", True)
    monkeypatch.setitem(campaigns.benches.BENCHES, "small", kind)


def play(file, folder, **options):
    return run_campaign(load_campaign(file), folder, address="small", **{"seed": 5, **options})


def content(path):
    with h5py.File(path) as log:
        values = {name: log["channels"][name][:] for name in log["channels"]}
        segments = [tuple(row) for row in log["segments"]]
        attributes = {k: log.attrs[k] for k in ("run_uid", "test", "status", "configuration", "seed", "bench")}
        return values, segments, attributes


def assert_equal_logs(first, second):
    for name in ("stops", "chop", "sines"):
        (va, sa, aa), (vb, sb, ab) = content(first / f"{name}.h5"), content(second / f"{name}.h5")
        assert va.keys() == vb.keys() and sa == sb and aa == ab
        for channel in va:
            np.testing.assert_array_equal(va[channel], vb[channel])


def bytes_of(folder):
    return {p.name: p.read_bytes() for p in folder.glob("*.h5")}


def test_what_the_logs_will_take_is_announced_before_there_is_one(file, tmp_path):
    told = []

    def announce(size_bytes):
        told.append((size_bytes, list((tmp_path / "runs").glob("*.h5"))))

    play(file, tmp_path / "runs", announce=announce)
    counted = sum(one.bytes for one in estimate_campaign(load_campaign(file), "small", 5).values())
    taken = sum(path.stat().st_size for path in (tmp_path / "runs").glob("*.h5"))
    # besides the numbers a log holds its header, its segments and an unfinished chunk
    assert told == [(counted, [])] and counted < taken < 1.2 * counted + 3e5 * 3
    play(file, tmp_path / "runs", announce=announce, resume=True)
    assert told[1][0] == 0


def test_paused_and_resumed_equals_uninterrupted(file, tmp_path):
    play(file, tmp_path / "whole")

    def interrupt(_done, _total, what):
        if what == "sines: 30 Hz":
            signal.raise_signal(signal.SIGINT)

    paused = play(file, tmp_path / "parts", report=interrupt)
    assert [r.status for r in paused.runs] == ["complete", "complete", "paused"] and paused.status == "paused"
    state = read_state(tmp_path / "parts")
    assert state is not None and state["status"] == "paused"
    before = bytes_of(tmp_path / "parts")

    resumed = play(file, tmp_path / "parts", resume=True)
    assert resumed.status == "complete"
    assert [r.played for r in resumed.runs] == [False, False, True]
    assert_equal_logs(tmp_path / "whole", tmp_path / "parts")
    after = bytes_of(tmp_path / "parts")
    # what was complete was not touched, and what was partial is kept under another name
    assert after["stops.h5"] == before["stops.h5"] and after["chop.h5"] == before["chop.h5"]
    assert after["sines.partial-1.h5"] == before["sines.h5"]
    assert set(after) == {"stops.h5", "chop.h5", "sines.h5", "sines.partial-1.h5"}

    assert not any(r.played for r in play(file, tmp_path / "parts", resume=True).runs)
    assert bytes_of(tmp_path / "parts") == after


@pytest.mark.parametrize("at", ["playing hold +++", "playing chop 2", "playing 30 Hz"])
def test_killed_and_resumed_equals_uninterrupted(file, tmp_path, at):
    play(file, tmp_path / "whole")
    command = [sys.executable, "-m", "tests.campaigns.playing.slow_run", "campaign", str(file), str(tmp_path / "parts")]
    settings: dict[str, Any] = {"cwd": ROOT, "stdout": subprocess.PIPE, "text": True}
    killed = subprocess.Popen(command, env=os.environ | {"SLOW_S": "0.1"}, **settings)
    assert killed.stdout is not None
    for line in killed.stdout:
        if line.strip() == at:
            killed.kill()
            break
    killed.communicate(timeout=30)
    assert killed.returncode == -signal.SIGKILL
    again = subprocess.run(command, env=os.environ | {"SLOW_S": "0"}, timeout=60, check=True, **settings)
    assert again.stdout.split()[-1] == "complete"
    assert_equal_logs(tmp_path / "whole", tmp_path / "parts")


@pytest.fixture
def many(monkeypatch):
    """Let the small bench be opened many times at once, on three cores."""
    kind = dataclasses.replace(campaigns.benches.BENCHES["small"], many=True)
    monkeypatch.setitem(campaigns.benches.BENCHES, "small", kind)
    monkeypatch.setattr("campaigns.playing.campaign_run.free_cores", lambda: 3)


def test_side_by_side_equals_one_after_the_other_bit_for_bit(file, tmp_path, request):
    play(file, tmp_path / "in turn")
    request.getfixturevalue("many")
    threads, told = set(), []

    def report(done, total, what):
        threads.add(threading.get_ident())
        told.append((done, total, what))

    assert play(file, tmp_path / "at once", report=report).status == "complete"
    assert_equal_logs(tmp_path / "in turn", tmp_path / "at once")
    assert len(threads) > 1
    done = [one[0] for one in told]
    assert done == sorted(done) and done[-1] < told[0][1] == told[-1][1]


@pytest.mark.usefixtures("many")
def test_paused_side_by_side_and_resumed_equals_uninterrupted(file, tmp_path):
    play(file, tmp_path / "whole")

    def interrupt(_done, _total, what):
        if what == "sines: 30 Hz":
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(0.1)  # the handler runs in the main thread, which another thread has to let go on

    paused = play(file, tmp_path / "parts", report=interrupt)
    assert paused.status == "paused" and paused.runs[-1].status == "paused"
    assert play(file, tmp_path / "parts", resume=True).status == "complete"
    assert_equal_logs(tmp_path / "whole", tmp_path / "parts")


@pytest.mark.usefixtures("many")
def test_an_error_in_one_run_ends_the_campaign_and_the_others_are_kept(file, tmp_path):
    def fail(_done, _total, what):
        if what == "sines: 30 Hz":
            raise DataError("no more")

    with pytest.raises(DataError, match="no more"):
        play(file, tmp_path / "parts", report=fail)
    state = read_state(tmp_path / "parts")
    assert state is not None and state["status"] == "failed"
    assert {run["name"]: run["status"] for run in state["runs"]} == {
        "stops": "complete",
        "chop": "complete",
        "sines": "failed",
    }


def test_a_folder_in_use_is_not_played_into(file, tmp_path):
    play(file, tmp_path / "out")
    before = bytes_of(tmp_path / "out")
    for options, says in (
        ({}, "holds a campaign already"),
        ({"resume": True, "seed": 6}, "seed was 5 and is 6"),
    ):
        with pytest.raises(ConfigError, match=says):
            play(file, tmp_path / "out", **options)
    changed = CAMPAIGN.replace("cycles = 2", "cycles = 3")
    (file.parent / "changed.toml").write_text(changed, encoding="utf-8")
    with pytest.raises(ConfigError, match="cannot be resumed: runs was"):
        play(file.parent / "changed.toml", tmp_path / "out", resume=True)
    assert bytes_of(tmp_path / "out") == before


def test_a_log_of_another_configuration_is_not_taken_for_this_one(file, tmp_path):
    play(file, tmp_path / "out")
    (tmp_path / "out" / "campaign.json").unlink()
    before = bytes_of(tmp_path / "out")
    with pytest.raises(ConfigError, match="another configuration"):
        play(file, tmp_path / "out", seed=6)
    assert bytes_of(tmp_path / "out") == before


def test_each_run_has_its_level_of_the_disturbance_and_its_log_says_so(file, tmp_path):
    text = CAMPAIGN.replace('name = "stops"', 'name = "stops"\ndisturbance = 0.25')
    (file.parent / "levels.toml").write_text(text, encoding="utf-8")
    play(file.parent / "levels.toml", tmp_path / "out")
    serials = {}
    for name in ("stops", "sines"):
        with read_run(tmp_path / "out" / f"{name}.h5") as run:
            serials[name] = run.header.bench["serial"]
    assert serials["stops"].endswith(" disturbance-0.25") and "disturbance" not in serials["sines"]
    # complete runs are kept under the same levels and refused under others
    assert play(file.parent / "levels.toml", tmp_path / "out", resume=True).status == "complete"
    with pytest.raises(ConfigError, match="cannot be resumed: runs was"):
        play(file, tmp_path / "out", resume=True)


def test_a_level_that_cannot_be_names_its_run(file, tmp_path):
    text = CAMPAIGN.replace('name = "sines"', 'name = "sines"\ndisturbance = -1.0')
    (file.parent / "levels.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=r"run 'sines'.*disturbance is -1"):
        play(file.parent / "levels.toml", tmp_path / "out")


def test_a_changed_design_model_is_noticed(file, tmp_path):
    play(file, tmp_path / "out")
    (file.parent / "design.toml").write_text(
        dump_model(bench_model(hardware=False)).replace("29.6", "29.7"), encoding="utf-8"
    )
    with pytest.raises(ConfigError, match="runs was"):
        play(file, tmp_path / "out", resume=True)


def test_a_run_beyond_the_limits_stops_the_campaign_before_the_first_run(file, tmp_path):
    text = CAMPAIGN.replace('name = "design.toml"', "").replace("cycles = 2", "cycles = 2, to_rad = 0.02")
    (file.parent / "far.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match="campaign 'three', run 'chop'.*0.02.*0.01"):
        play(file.parent / "far.toml", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_runs_have_independent_seeds_that_the_order_does_not_change():
    assert run_seed(0, "a") == run_seed(0, "a")
    assert len({run_seed(s, n) for s in range(20) for n in ("a", "b", "ab", "ba")}) == 80
    assert all(0 <= run_seed(s, "a") < 2**63 for s in range(100))


def test_a_second_process_is_kept_out(file, tmp_path):
    def nested(_done, _total, _what):
        play(file, tmp_path / "out", resume=True)

    with pytest.raises(ConfigError, match="another mccd"):
        play(file, tmp_path / "out", report=nested)
    # the error ended the first run; its log says so and the folder can be resumed
    assert play(file, tmp_path / "out", resume=True).status == "complete"


def test_a_log_whose_reader_was_kept_waiting_is_neither_played_again_nor_moved(file, tmp_path, monkeypatch):
    play(file, tmp_path / "a")
    before = bytes_of(tmp_path / "a")
    probe._end()  # noqa: SLF001 a child of a test before
    monkeypatch.setattr(probe, "is_own", lambda _path: False)
    monkeypatch.setattr(probe, "may_fork", lambda: False)
    monkeypatch.setattr(probe, "CHILD", "import time; print('ready', flush=True); time.sleep(600)")
    monkeypatch.setattr(probe, "time_limit_s", lambda _path: 0.1)
    monkeypatch.setattr("campaigns.log.child.WAIT_S", 0.2)
    with pytest.raises(DataError, match="took too long"):
        play(file, tmp_path / "a", resume=True)
    assert bytes_of(tmp_path / "a") == before


def test_a_broken_state_file_is_named(file, tmp_path):
    play(file, tmp_path / "out")
    (tmp_path / "out" / "campaign.json").write_text("{", encoding="utf-8")
    with pytest.raises(DataError, match="campaign.json"):
        play(file, tmp_path / "out", resume=True)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("name = 3", "name"),
        ('name = "x"\nruns = []', "give one at least"),
        ('name = "x"\nspeed = 1\nruns = []', "speed"),
        (CAMPAIGN.replace('"chop"', '"stops"', 1), "name each run once"),
        (CAMPAIGN.replace('plan = "chop"', 'plan = "chip"'), "no plan 'chip'"),
        (CAMPAIGN.replace("cycles = 2", "cycle = 2"), "run 'chop'.*cycle"),
        (CAMPAIGN.replace('name = "stops"', 'name = "../stops"'), "cannot be a name"),
        (CAMPAIGN.replace('name = "three"', 'name = "../three"'), "campaign '../three' cannot be a name"),
        (CAMPAIGN.replace("[[runs]]", "[[runs", 1), "not valid TOML"),
    ],
)
def test_a_wrong_campaign_file_is_one_clear_line(text, says):
    with pytest.raises(ConfigError, match=says) as error:
        parse_campaign(text, "three.toml")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", bundled_campaigns())
def test_bundled_campaigns_keep_the_limits_of_the_bench_as_built(name):
    estimates = estimate_campaign(load_campaign(name), "sim", 0)
    assert all(e.peak_current_a <= e.limit_current_a == 9.0 for e in estimates.values())
    assert all(e.peak_current_a > 0.0 for name, e in estimates.items() if name.startswith(("sweep", "chop", "hyst")))


def test_the_paper_campaign_holds_every_test_of_the_paper():
    runs: list[Any] = list(load_campaign("paper").plans().values())
    chops = {(p.alpha_deg, p.from_rad, p.to_rad) for p in runs if p.name == "chop"}
    forms = [(0.0, 8.5e-3), (0.0, -8.5e-3), (-8.5e-3, 8.5e-3)]
    assert chops == {(a, *form) for a in (0.0, 120.0, 240.0) for form in forms}
    assert {p.name for p in runs} == {
        "chop",
        "endstops",
        "hysteresis",
        "rest",
        "settling",
        "sinesweep",
        "theodolite",
        "thermal",
    }
    assert {p.cold_finger_k for p in runs if p.name == "sinesweep"} == {None, 77.0, 63.5}
    assert max(p.cycles / p.frequency_hz for p in runs if p.name == "thermal") == 300.0


def test_an_unknown_bench_is_named_with_those_there_are():
    with pytest.raises(ConfigError, match=r"no bench 'toaster'; benches: sim\[:MODEL\]"):
        open_bench("toaster", 0)


def test_an_emulated_bench_gets_its_level_too():
    with contextlib.closing(open_bench("emulator", 3, 0.5)) as bench:
        assert bench.identity.serial == "seed-3 disturbance-0.5"


def test_a_simulated_bench_of_a_file(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(dump_model(bench_model()), encoding="utf-8")
    assert open_bench(f"sim:{path}", 4).identity.name == "mine"
    with pytest.raises(ConfigError, match="nowhere.toml"):
        open_bench("sim:nowhere.toml", 0)


def test_a_log_whose_checksum_a_kill_prevented_is_played_again(file, tmp_path):
    play(file, tmp_path / "whole")
    play(file, tmp_path / "parts")
    before = bytes_of(tmp_path / "parts")
    (tmp_path / "parts" / "chop.h5.sha256").unlink()
    resumed = play(file, tmp_path / "parts", resume=True)
    assert [r.name for r in resumed.runs if r.played] == ["chop"]
    assert_equal_logs(tmp_path / "whole", tmp_path / "parts")
    assert verify(tmp_path / "parts" / "chop.h5").ok
    assert bytes_of(tmp_path / "parts")["chop.partial-1.h5"] == before["chop.h5"]


@pytest.mark.parametrize("kind", ["link", "pipe", "folder"])
def test_what_has_the_name_of_the_lock_is_left_alone(file, tmp_path, kind):
    out, precious = tmp_path / "out", tmp_path / "precious"
    out.mkdir()
    precious.write_text("precious")
    lock = out / ".campaign.lock"
    {"link": lambda: lock.symlink_to(precious), "pipe": lambda: os.mkfifo(lock), "folder": lock.mkdir}[kind]()
    with pytest.raises(ConfigError, match=r"\.campaign\.lock is (a link|not an ordinary file).*remove it"):
        play(file, out)
    assert precious.read_text() == "precious" and list(out.iterdir()) == [lock]
