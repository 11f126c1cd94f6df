"""The tests of the campaign from the command line: results, limits, exit codes, dry runs and wrong demands."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest

from campaigns.playing.campaign import load_campaign
from campaigns.playing.campaign_run import CampaignOutcome
from campaigns.playing.counting import estimate_campaign
from campaigns.strategies import STRATEGIES
from mccdcli import chop_options
from mccdcli.commands.report import OWN_LOGS
from mccdcli.main import main

ROOT = Path(__file__).parents[3]
TESTS = ("chop", "settle", "endstops", "theodolite", "hysteresis", "thermal", "simulate", "identify")


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(here, capsys):
    """Return a function that runs a command line in this process and returns (exit code, standard output, error)."""

    def call(*arguments):
        code = main(list(arguments))
        said = capsys.readouterr()
        return code, said.out, said.err

    return call


@pytest.mark.parametrize("command", ["chop", "settle"])
def test_the_help_lists_every_strategy(run, command):
    assert chop_options.STRATEGIES == tuple(STRATEGIES)
    _, out, _ = run(command, "--help")
    assert ", ".join(STRATEGIES) in re.sub(r"\s+", " ", re.sub(r"-\n\s+", "-", out))


@pytest.mark.parametrize("command", TESTS)
def test_a_dry_run_counts_and_writes_nothing(run, here, command):
    code, out, _ = run(command, "--dry-run", "--json")
    counted = json.loads(out)["runs"]
    assert code == 0 and list(here.iterdir()) == []
    for one in counted.values():
        assert one["segments"] > 0 and one["duration_s"] == pytest.approx(one["samples"] / 10_000.0)
        assert one["bytes"] == 8 * one["samples"] * one["channels"]
        assert one["peak_current_a"] <= one["limit_current_a"] == 9.0


def test_a_chop_that_moves_nothing_has_no_settling(run, here):
    chopped = ("--cycles", "2", "--frequency", "5", "--set", "window_s=0.05", "--set", "to_rad=1e-10", "--json")
    code, out, _ = run("chop", *chopped)
    assert code in (0, 1) and json.loads(out)["settling_ms"] is None
    code, _, err = run("settle", "--set", "to_rad=1e-10")
    assert code == 4 and "1 nrad apart" in err and "set from_rad and to_rad" in err


def test_chop_reports_what_its_log_shows(run, here):
    code, out, err = run("chop", "--cycles", "2", "--alpha", "120", "--json", "--seed", "4")
    result = json.loads(out)
    with h5py.File(here / "chop.h5") as file:
        angles = np.stack([file["channels"][n][:] for n in ("theta_x", "theta_y")], axis=1)
        assert file.attrs["seed"] == 4 and file.attrs["status"] == "complete"
    # 1 s approach, then 1 s at position 2 and 1 s at position 1 in turn, of which the last halves count
    windows = angles[10_000:].reshape(2, 2, 10_000, 2)[:, :, 5_000:]
    offsets = windows - windows.mean(axis=(0, 2), keepdims=True)
    sigma = np.sqrt(np.mean(offsets**2, axis=(0, 2)))
    assert result["stability_urad_3sigma"] == pytest.approx(3e6 * sigma.max(), rel=1e-9)
    inside = 100.0 * np.mean(np.hypot(offsets[..., 0], offsets[..., 1]) <= 1.7e-6, axis=(0, 2))
    assert result["inside_percent"] == pytest.approx(inside[::-1], rel=1e-9)
    failed = [c for c in result["checks"] if not c["ok"]]
    assert result["passed"] == (not failed) and code == (1 if failed else 0)
    assert all(c["value"] > c["limit"] for c in failed)


def test_a_command_never_overwrites(run, here):
    assert run("endstops", "--set", "hold_s=0.05", "--set", "settle_s=0.3")[0] in (0, 1)
    before = (here / "endstops.h5").read_bytes()
    code, out, err = run("endstops", "--set", "hold_s=0.05")
    assert code == 2 and "endstops.h5 exists" in err and err.count("\n") == 1
    assert (here / "endstops.h5").read_bytes() == before


def test_the_simulated_theodolite_finds_the_gains_that_the_bench_was_given(run):
    code, out, _ = run("theodolite", "--json")
    result = json.loads(out)["result"]["calibration"]
    # section 6.2.1: 0.5 % and 0.4 %, which the bench as built has as input; its noise leaves parts in 1e5
    assert result["gain_correction"] == pytest.approx([0.005, 0.004], abs=1e-4)
    assert code == 0


def test_readings_from_a_file_take_the_instruments_place(run, here):
    points = [(x, y) for x in (-4e-3, 0.0, 4e-3) for y in (-4e-3, 0.0, 4e-3)]
    rows = "\n".join(f"{1.01 * x},{0.98 * y}" for x, y in points)
    (here / "readings.csv").write_text(f"theta_x,theta_y\n{rows}\n")
    grid = ("--set", "x_rad=[-4e-3, 0.0, 4e-3]", "--set", "y_rad=[-4e-3, 0.0, 4e-3]")
    code, out, _ = run("theodolite", "--readings", "readings.csv", "--json", *grid)
    # the loop holds the sensors on the grid, so the line is what the file was made with, within 0.1 µrad of 4 mrad
    assert json.loads(out)["result"]["calibration"]["gain_correction"] == pytest.approx([0.01, -0.02], abs=5e-5)
    assert code == 1  # 2 % at 8.5 mrad is 170 µrad, beyond 85 µrad

    (here / "short.csv").write_text("theta_x,theta_y\n1e-3,hello\n")
    code, _, err = run("theodolite", "--readings", "short.csv", *grid)
    assert code == 4 and "short.csv: 1 rows" in err and "9 held points" in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("chop", "--form", "0:+12"), "reaches 0.012 (rad, m), the end stop is at 0.01"),
        (("chop", "--form", "0:+8.5:3"), "is not a pair of positions"),
        (("chop", "--form", "8.5"), "is not a pair of positions"),
        (("chop", "--strategy", "magic"), "no strategy 'magic'"),
        (("chop", "--model", "nowhere.toml"), "nowhere.toml"),
        (("chop", "--set", "cycle=3"), "unknown field `cycle`"),
        (("chop", "--set", "cycles"), "is not NAME=VALUE"),
        (("chop", "--cycles", "2", "--set", "cycles=3"), "--cycles and --set cycles choose the same"),
        (("settle", "--form", "0:2", "--set", "to_rad=1e-3"), "--form and --set to_rad choose the same"),
        (("settle", "--strategy", "designed", "--model", "design"), "--model has no effect: a controller is played"),
        (("hysteresis", "--axis", "theta_x", "--set", "axis=theta_y"), "--axis and --set axis choose the same"),
        (("simulate", "--waveform", __file__, "--plan", "rest"), "--plan chooses a plan, and --waveform is played"),
        (("simulate", "--waveform", __file__, "--set", "file=a.csv"), "--set file and --waveform choose the same"),
        (("settle", "--model", "design", "--alpha", "0"), "A, an amplifier gives 9 A"),
        (("endstops", "--set", "current_a=12.0"), "asks for 12 A, an amplifier gives 9 A"),
        (("simulate", "--plan", "freerum"), "no plan 'freerum'"),
        (("endstops", "--bench", "toaster"), "not a bench"),
        (("endstops", "--bench", "sim:nowhere"), "model 'nowhere'"),
        (("campaign", "run", "nowhere.toml"), "nowhere.toml"),
    ],
)
def test_a_wrong_demand_is_one_line_and_exit_code_2(run, here, arguments, says):
    code, out, err = run(*arguments)
    assert code == 2 and out == "" and list(here.iterdir()) == []
    assert says in err and err.startswith("mccd: error: ") and err.count("\n") == 1


def test_simulate_plays_a_waveform_on_any_model(run, here):
    n = np.arange(2_000)
    (here / "wave.csv").write_text("theta_x\n" + "\n".join(repr(float(0.01 * np.sin(0.01 * k))) for k in n))
    code, out, _ = run("simulate", "--model", "design", "--waveform", "wave.csv", "--out", "own.h5", "--json")
    assert code == 0 and json.loads(out)["log"] == "own.h5"
    with h5py.File(here / "own.h5") as file:
        np.testing.assert_array_equal(file["channels"]["command_theta_x"][:], 0.01 * np.sin(0.01 * n))
        assert "sha256" in file.attrs["configuration"]


def test_identify_finds_the_modes_that_a_model_was_given(run, here):
    bands = "[{ start_hz = 10.0, stop_hz = 100.0, step_hz = 5.0, settle_s = 2.5, measure_s = 0.2 }]"
    code, out, _ = run(
        "identify", "--bench", "sim:table-6.4-30", "--axis", "theta_x", "--set", f"bands={bands}", "--json"
    )
    found = json.loads(out)["identification"]
    with (here / "nominal.toml").open("rb") as file:
        model = tomllib.load(file)
    # Table 6.2: 29.56 Hz, 4.79 1/s; after 2.5 s the transient is e^(-12) of the response
    assert code == 0 and len(model["modes"]) == 1
    assert model["modes"][0]["frequency_hz"]["value"] == pytest.approx(29.5610512699, rel=1e-5)
    assert found["modes"][0]["decay_rate_1_s"] == pytest.approx(4.78896638146, rel=1e-4)
    assert model["modes"][0]["frequency_hz"]["origin"] == "fitted"

    code, _, err = run("identify", "--bench", "sim:table-6.4-30")
    assert code == 2 and "nominal.toml exists" in err and err.count("\n") == 1
    code, out, _ = run("identify", "--log", "nominal.runs/sweep-theta_x.h5", "--out", "again.toml", "--json")
    assert code == 0 and json.loads(out)["identification"]["modes"] == found["modes"]


def test_large_logs_are_announced_before_anything_is_played(run, here, monkeypatch):
    (here / "small.toml").write_text(
        'name = "small"\n[[runs]]\nname = "stops"\nplan = "endstops"\n'
        "settings = { ramp_s = 0.02, settle_s = 0.02, hold_s = 0.02 }\n"
    )
    assert "mccd: the logs" not in run("campaign", "run", "small.toml", "--out", "quiet")[2]
    monkeypatch.setattr("mccdcli.trials.LARGE_BYTES", 1e4)
    monkeypatch.setattr("campaigns.playing.campaign_run._play", lambda *_: 1 / 0)
    code, out, err = run("campaign", "run", "small.toml", "--out", "told")
    assert (code, out) == (70, "") and err.startswith("mccd: the logs will take 0 MB in told\nmccd: error: ")
    code, _, err = run("report", "--campaign", "small.toml", "--out", "report")
    said = "mccd: the logs will take 0 MB in report/campaign, and then about 310 MB in report/designed\n"
    assert err.startswith(said)


@pytest.mark.parametrize(
    ("arguments", "how"),
    [
        (("campaign", "run", "quick"), "the same command with --resume continues"),
        (("thermal", "--no-sweeps"), "the same command with --resume continues"),
        (("identify", "--axis", "theta_x"), "the same command continues"),
        (("report",), "the same command continues"),
        (("settle", "--strategy", "designed"), "the same command continues"),
    ],
)
def test_an_interrupt_says_how_this_command_continues(run, here, monkeypatch, arguments, how):
    def paused(campaign, folder, **_):
        return CampaignOutcome(campaign.name, folder, "paused", ())

    monkeypatch.setattr("campaigns.playing.campaign_run.run_campaign", paused)
    code, _, err = run(*arguments)
    assert code == 130 and err.splitlines()[-1].endswith(f"holds what was recorded; {how}")


def test_thermal_continues_in_its_folder(run, here):
    short = ("thermal", "--no-sweeps", "--set", "cycles=12")
    first = run(*short)
    before = (here / "thermal" / "thermal.h5").read_bytes()
    code, _, err = run(*short)
    assert code == 2 and "continue it with --resume" in err
    assert run(*short, "--resume")[:2] == first[:2]
    assert (here / "thermal" / "thermal.h5").read_bytes() == before


def test_a_dry_run_says_what_it_does_not_count(run, here):
    rest = ("simulate", "--plan", "rest", "--set", "duration_s=0.1", "--set", "settle_s=0.1", "--out", "still.h5")
    assert run(*rest)[0] == 0
    design = ("design", "--model", "design", "--dry-run", "--json")
    assert set(json.loads(run(*design)[1])["runs"]) == {"rest"}
    code, out, err = run(*design, "--log", "still.h5", "--stages")
    assert code == 0 and json.loads(out)["runs"] == {} and "the chops of --stages are not counted" in err
    (here / "design").mkdir()
    (here / "still.h5").rename(here / "design" / "rest.h5")
    assert json.loads(run(*design)[1])["runs"] == {}
    (here / "small.toml").write_text('name = "small"\n[[runs]]\nname = "a"\nplan = "rest"\n')
    assert run("report", "--campaign", "small.toml", "--dry-run")[2] == ""  # no sweep: no controller is designed
    with (here / "small.toml").open("a") as file:
        file.write('[[runs]]\nname = "b"\nplan = "sinesweep"\n')
    assert OWN_LOGS in run("report", "--campaign", "small.toml", "--dry-run")[2]
    assert OWN_LOGS not in run("report", "--campaign", "small.toml", "--no-design", "--dry-run")[2]


def test_plans_are_listed_with_what_set_takes(run):
    code, out, _ = run("campaign", "list", "--plans")
    rows = [line.split() for line in out.splitlines()]
    assert code == 0
    for row in (["alpha_deg", "0", "°"], ["window_s", "0.5", "s"], ["torque_nm", "0.045", "N", "m"]):
        assert row in rows
    assert ["axes", '["theta_x",', '"theta_y",', '"z"]'] in rows and ["controller", "none"] in rows
    assert ["tuning.feedback_factor", "1.5"] in rows
    listed = json.loads(run("campaign", "list", "--plans", "--json")[1])["plans"]
    assert {name for plan in listed for name in plan["settings"]} <= {row[0].partition(".")[0] for row in rows if row}


def test_readme_and_tutorial_say_what_the_logs_of_a_report_take():
    counted = sum(one.bytes for one in estimate_campaign(load_campaign("paper"), "sim", 0).values()) / 1e6
    own = float(OWN_LOGS.removesuffix(" MB"))
    for page in ("README.md", "docs/tutorial.md"):
        said = re.search(r"(\d+) MB of logs", (ROOT / page).read_text(encoding="utf-8"))
        assert said is not None and float(said[1]) == pytest.approx(counted + own, rel=0.03)


def test_campaigns_are_run_resumed_and_shown(run, here):
    (here / "small.toml").write_text(
        'name = "small"\n[[runs]]\nname = "stops"\nplan = "endstops"\n'
        "settings = { ramp_s = 0.02, settle_s = 0.02, hold_s = 0.02 }\n"
    )
    code, out, _ = run("campaign", "run", "small.toml", "--out", "runs", "--json")
    assert code == 0 and json.loads(out)["status"] == "complete"
    before = (here / "runs" / "stops.h5").read_bytes()
    code, _, err = run("campaign", "run", "small.toml", "--out", "runs")
    assert code == 2 and "--resume" in err and err.count("\n") == 1
    assert run("campaign", "run", "small.toml", "--out", "runs", "--resume")[0] == 0
    assert (here / "runs" / "stops.h5").read_bytes() == before
    code, out, _ = run("campaign", "show", "runs", "--json")
    assert [(r["name"], r["status"]) for r in json.loads(out)["runs"]] == [("stops", "complete")]
    assert run("campaign", "show", "paper")[0] == 0
    assert {c["name"] for c in json.loads(run("campaign", "list", "--json")[1])["campaigns"]} >= {"paper", "quick"}


def test_benches_are_listed_with_the_models_of_the_simulated_one(run):
    code, out, _ = run("bench", "list", "--json")
    listed = json.loads(out)
    assert code == 0 and "as-built" in listed["models"]
    assert "sim[:MODEL]" in [b["bench"] for b in listed["benches"]]


def test_an_interrupted_command_ends_with_130_and_a_paused_log(here):
    command = [sys.executable, "-m", "mccdcli", "thermal", "--no-sweeps", "--out", "out", "--set", "cycles=20000"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=os.environ)
    while process.poll() is None and not (here / "out" / "thermal.h5").exists():
        signal.sigtimedwait([], 0.05)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "paused" in said.splitlines()[-1] and "--resume continues" in said and "Traceback" not in said
    with h5py.File(here / "out" / "thermal.h5") as file:
        assert file.attrs["status"] == "paused"
