"""`mccd diagnose` as its users run it: files, exit codes, and one line for every bad input."""

from __future__ import annotations

import json
import os
from xml.etree import ElementTree

import numpy as np
import pytest

from campaigns.log import Channel, LogWriter
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from mccdcli.junit import Case, write_junit
from sim_backend.model import EffectEntry, dump_model, load_model
from sim_backend.simbench import SimBench
from tests.small_bench import NOISE, bench_model

SHORT = {"axes": ["theta_x", "theta_y"], "steps_s": 1.5, "noise_s": 1.0, "held_out_s": 0.8}


@pytest.fixture
def nominal(tmp_path):
    path = tmp_path / "nominal.toml"
    path.write_text(dump_model(bench_model(hardware=False)))
    return path


def free_run(tmp_path, *effects):
    path = tmp_path / "free.h5"
    run_plan(make_plan("freerun", SHORT), SimBench(bench_model((*effects, *NOISE)), 5), path, seed=5, note="new cable")
    return path


def test_a_model_that_is_right_ends_with_0_and_all_files(mccd, tmp_path, nominal):
    run, out = free_run(tmp_path), tmp_path / "out"
    junit = out / "checks.xml"  # in the folder that is made
    checked = ("--expect", "consistent", "--junit", str(junit))
    done = mccd("diagnose", str(run), "--model", str(nominal), "-o", str(out), "--json", *checked)
    assert done.returncode == 0, done.stderr
    assert "check:" not in done.stderr
    assert [(c.get("name"), len(c)) for c in cases_of(junit)] == [("consistent with free.h5", 0)]
    found = json.loads(done.stdout)
    assert found == json.loads((out / "diagnosis.json").read_text())
    assert found["verdict"] == "consistent" and found["causes"] == []
    assert found["inputs"][0]["file"] == str(run)
    page = (out / "index.html").read_text()
    assert found["sentence"] in page and "new cable" in page
    assert load_model(out / "extended.toml").effects == []
    assert list((out / "figures").glob("*.svg"))


def test_a_model_that_is_wrong_ends_with_1_and_an_extended_model_that_runs(mccd, tmp_path, nominal):
    friction = EffectEntry(effect="coulomb-friction", where="theta_x", parameters={"torque": 1e-3})
    run, out = free_run(tmp_path, friction), tmp_path / "out"
    junit = tmp_path / "diagnosis.xml"
    checked = ("--expect", "consistent", "--junit", str(junit))
    done = mccd("diagnose", str(run), "--model", str(nominal), "-o", str(out), *checked)
    assert done.returncode == 1, done.stderr
    found = json.loads((out / "diagnosis.json").read_text())
    (told,) = [line for line in done.stderr.splitlines() if "check:" in line]
    assert f"is {found['verdict']}, not consistent" in told and found["sentence"] in told
    (case,) = cases_of(junit)
    assert case[0].tag == "failure" and found["sentence"] in case[0].get("message")
    assert found["verdict"] != "consistent"
    assert found["gain"]["rms_after"] <= found["gain"]["rms_before"]
    assert done.stdout.startswith(found["sentence"])
    simulated = mccd("simulate", "--model", str(out / "extended.toml"), "--out", str(tmp_path / "again.h5"))
    assert simulated.returncode == 0, simulated.stderr


def cases_of(path):
    return list(ElementTree.parse(path).getroot().iter("testcase"))


def other_log(tmp_path, **changed):
    rng = np.random.default_rng(0)
    values = {"command_theta_x": rng.standard_normal(500), "theta_x": rng.standard_normal(500)} | changed
    channels = [
        Channel("command_theta_x", "N m", "input", "theta_x", 1e4),
        Channel("theta_x", "rad", "output", "theta_x", 1e4),
    ]
    path = tmp_path / "other.h5"
    with LogWriter.create(path, channels, test="t", bench={"kind": "sim", "name": "n"}) as log:
        log.append(values)
    return path


@pytest.fixture
def one_axis(tmp_path):
    import msgspec

    whole = bench_model(hardware=False)
    path = tmp_path / "one-axis.toml"
    x_only = msgspec.structs.replace(whole, inputs=whole.inputs[:1], outputs=whole.outputs[:1], modes=whole.modes[:1])
    path.write_text(dump_model(x_only))
    return path


def assert_refused(done, code, *words):
    assert done.returncode == code
    assert done.stdout == "" and "Traceback" not in done.stderr
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith("mccd: error: ")
    for word in words:
        assert word in line


def test_a_model_of_other_channels_is_a_matter_of_configuration(mccd, tmp_path, nominal):
    done = mccd("diagnose", str(other_log(tmp_path)), "--model", str(nominal), "-o", str(tmp_path / "out"))
    assert_refused(done, 2, "other.h5", "no input channel", "theta_y")


def test_dead_and_short_records_are_a_matter_of_data(mccd, tmp_path, one_axis):
    dead = other_log(tmp_path, theta_x=np.zeros(500))
    junit = tmp_path / "diagnosis.xml"
    write_junit(junit, "mccd diagnose", [Case("of last night", "which passed")])
    more = ("-o", str(tmp_path / "out"), "--junit", str(junit))
    done = mccd("diagnose", str(dead), "--model", str(one_axis), *more)
    assert_refused(done, 4, "other.h5", "theta_x", "constant at 0")
    assert not junit.exists()


@pytest.mark.parametrize("taken", ["text", "log", "model", "another suite", "folder", "link to a log"])
def test_a_junit_file_takes_the_place_of_nothing_else(mccd, tmp_path, one_axis, taken):
    run = other_log(tmp_path)
    where = {"log": run, "model": one_axis}.get(taken, tmp_path / "here.xml")
    if taken == "text":
        where.write_text("a letter")
    elif taken == "another suite":
        where.write_text('<?xml version="1.0" encoding="utf-8"?><testsuites name="pytest tests"></testsuites>')
    elif taken == "folder":
        where.mkdir()
    elif taken == "link to a log":
        where.symlink_to(run)
    before = None if where.is_dir() else where.read_bytes()
    done = mccd("diagnose", str(run), "--model", str(one_axis), "-o", str(tmp_path / "out"), "--junit", str(where))
    assert done.returncode == 2 and done.stdout == "", done.stderr
    if taken == "folder":  # the option itself says so
        return
    assert_refused(done, 2, str(where), "exists and is not a JUnit file", "give another name")
    assert where.read_bytes() == before and not (tmp_path / "out").exists()


def test_a_junit_file_is_never_a_device(mccd, tmp_path, one_axis):
    run = other_log(tmp_path)
    device = tmp_path / "pipe"
    os.mkfifo(device)
    (tmp_path / "stdout").symlink_to("/proc/self/fd/1")
    for name in ("pipe", "stdout"):
        done = mccd("diagnose", str(run), "--model", str(one_axis), "--junit", str(tmp_path / name))
        assert_refused(done, 2, name, "no file that could be written")
        assert os.path.lexists(tmp_path / name)


def test_a_junit_file_that_cannot_be_written_is_told_before_the_work(mccd, tmp_path, one_axis):
    run = other_log(tmp_path)
    given = ("-o", str(tmp_path / "out"), "--junit", str(tmp_path / "nowhere" / "a.xml"))
    done = mccd("diagnose", str(run), "--model", str(one_axis), *given)
    assert_refused(done, 4, "nowhere/a.xml", "No such file or directory")
    assert not (tmp_path / "out").exists()


def test_an_unknown_effect_to_leave_out_is_refused(mccd, tmp_path, one_axis):
    run = other_log(tmp_path)
    done = mccd("diagnose", str(run), "--model", str(one_axis), "--without", "ghosts", "-o", str(tmp_path / "out"))
    assert_refused(done, 2, "ghosts")


def test_a_missing_model_is_refused(mccd, tmp_path):
    done = mccd("diagnose", str(other_log(tmp_path)), "--model", "nowhere.toml", "-o", str(tmp_path / "out"))
    assert_refused(done, 2, "nowhere.toml")


@pytest.mark.parametrize("tolerance", ["0%", "-10%", "200%", "nan%", "%", "0.03", "3"])
def test_a_tolerance_is_a_share_above_zero_in_percent(mccd, tmp_path, one_axis, tolerance):
    run = other_log(tmp_path)
    done = mccd("diagnose", str(run), "--model", str(one_axis), "--nominal-tolerance", tolerance)
    assert_refused(done, 2, "nominal-tolerance")
