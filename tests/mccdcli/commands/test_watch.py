"""`mccd watch` beside a process that writes: it sees the run grow, is right about it, and leaves it alone."""

from __future__ import annotations

import contextlib
import json
import os
import re
import subprocess
import sys
import time
import warnings
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from threading import Thread

import msgspec
import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from analysis.recorded.watching import Watch
from campaigns.log import Channel, LogWriter, read_run, verify
from mccdcli.main import main
from sim_backend.model import dump_model
from tests import running
from tests.small_bench import bench_model

ROOT = Path(__file__).parents[3]


@pytest.fixture
def writing(tmp_path: Path) -> Iterator[tuple[Path, subprocess.Popen[str]]]:
    """A log that a process of its own is writing, ten segments with a pause after each."""
    log = tmp_path / "run.h5"
    process = subprocess.Popen(
        [*running.PYTHON, "-m", "tests.campaigns.playing.slow_run", "run", str(log), "-"],
        cwd=ROOT,
        env=os.environ | {"SLOW_S": "0.4"},
        stdout=subprocess.PIPE,
        text=True,
    )

    def ended() -> None:
        # whoever waits for the log of a writer that has failed would wait for ever
        process.wait()
        log.touch()

    Thread(target=ended, daemon=True).start()
    yield log, process
    process.kill()
    process.communicate()


def test_it_follows_a_run_to_its_end_without_disturbing_it(writing, tmp_path, capsys):
    log, process = writing
    model = tmp_path / "model.toml"
    model.write_text(dump_model(bench_model()), encoding="utf-8")
    assert main(["watch", str(log), "--wait", "--every", "0.1", "--model", str(model), "--json"]) == 0
    seen = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert process.communicate(timeout=30)[0].splitlines()[-1] == "complete"

    # it grew before its eyes, and was known to be running
    assert len(seen) > 4 and {one["status"] for one in seen[:-1]} == {"running"} and seen[-1]["status"] == "complete"
    assert all(a["rows"] <= b["rows"] for a, b in pairwise(seen)) and seen[0]["rows"] < seen[-1]["rows"]
    with read_run(log) as run:
        assert {one["expected_rows"] for one in seen} == {run.rows} == {seen[-1]["rows"]}
        assert seen[-1]["readings"][0]["last"] == run.read(seen[-1]["readings"][0]["name"])[-1]
        assert seen[-1]["segment"] == run.segments[-1].label
    left = [one["left_s"] for one in seen if one["left_s"] is not None]
    assert left and left[-1] == 0.0 and max(left) < 60.0

    # the writer ended as if nobody had looked: every chunk and the checksum are right
    assert verify(log).ok

    # the residual, against another simulation of the same model over the same seconds
    with read_run(log) as run:
        u = np.zeros((run.rows, 3))  # the sweep drives θx alone
        u[:, 0] = run.read(run.names("input")[0])
        names = [port.name for port in bench_model().outputs]
        a, b, c, d = bench_model().linear().state_space()
        ad, bd, cd, dd, dt = cont2discrete((a, b, c, d), 1.0 / run.sample_rate_hz)
        _, simulated, _ = dlsim((ad, bd, cd, dd, dt), u)
        last = slice(run.rows - round(2.0 * run.sample_rate_hz), None)
        for k, name in enumerate(names):
            expected = np.sqrt(np.mean((run.read(name)[last] - simulated[last, k]) ** 2))
            assert seen[-1]["misfits"][k]["residual_rms"] == pytest.approx(expected, rel=1e-6)


def test_once_shows_a_finished_run_as_text_and_as_json(tmp_path, capsys):
    path = tmp_path / "run.h5"
    angle = 1e-3 * np.sin(np.linspace(0.0, 20.0, 1000))
    with LogWriter.create(
        path, [Channel("theta_x", "rad", "output", "theta_x", 1e4)], test="chop", bench={}, expected_rows=4000
    ) as log:
        with log.segment("half way", {}):
            log.append({"theta_x": angle})
        log.set_status("paused", "by hand\x1b[2J")
    assert main(["watch", str(path), "--once"]) == 0
    out = capsys.readouterr().out
    assert "paused (by hand\\x1b[2J)" in out and "1000 of 4000 samples (25 %)" in out and "0 s" in out
    assert "\x1b" not in out and "▁" in out and "█" in out
    assert main(["watch", str(path), "--once", "--json"]) == 0
    one = json.loads(capsys.readouterr().out)
    reading = one["readings"][0]
    assert (reading["last"], reading["low"], reading["high"]) == (angle[-1], angle.min(), angle.max())
    assert main(["watch", str(path), "--once", "--every", "1"]) == 2
    assert "--every has no effect" in capsys.readouterr().err


def test_a_run_that_failed_is_a_failed_check_and_a_missing_one_is_refused(tmp_path, capsys):
    path = tmp_path / "run.h5"
    with pytest.raises(ValueError, match="broken"):
        with LogWriter.create(path, [Channel("a", "rad", "output", "", 1e4)], test="t", bench={}):
            raise ValueError("broken")
    assert main(["watch", str(path)]) == 1
    assert main(["watch", str(tmp_path / "none.h5"), "--once"]) == 4
    assert "none.h5" in capsys.readouterr().err


def test_a_delay_and_blocks_of_any_length_give_what_one_pass_gives(tmp_path):
    # two samples and a part of one
    model = msgspec.structs.replace(bench_model(), delay_s={"torque_x": 2.3e-4})
    rng = np.random.default_rng(5)
    u = 1e-3 * rng.normal(size=(3000, 3))
    ins, outs = [p.name for p in model.inputs], [p.name for p in model.outputs]
    channels = [Channel(p.name, p.unit, "input", p.dof, 1e4) for p in model.inputs]
    channels += [Channel(p.name, p.unit, "output", p.dof, 1e4) for p in model.outputs]
    # the cubic through the samples 1 to 4 ago, by Lagrange's formula, 2.3 ago
    nodes = np.arange(1, 5)
    weights = [np.prod([(2.3 - m) / (k - m) for m in nodes if m != k]) for k in nodes]
    shifted = u.copy()
    shifted[:, 0] = sum(w * np.concatenate([np.zeros(k), u[:-k, 0]]) for k, w in zip(nodes, weights, strict=True))
    a, b, c, d = model.linear().state_space()
    _, simulated, _ = dlsim(cont2discrete((a, b, c, d), 1e-4), shifted)
    watch = Watch(tmp_path, model, window_s=0.05)
    for stop in (1, 700, 701, 3000):
        # the file as it stood then; one process cannot write a file and read it without a lock
        watch.path = tmp_path / f"{stop}.h5"
        with LogWriter.create(watch.path, channels, test="t", bench={}, chunk_rows=7) as log:
            log.append(dict(zip(ins + outs, np.hstack([u[:stop], simulated[:stop]]).T, strict=True)))
        seen = watch.look(time.monotonic())
        # rounding of a recursion over 3000 samples, against outputs of up to 1e-4
        assert seen.rows == stop and max(one.residual_rms for one in seen.misfits) < 1e-14


@pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals")
def test_on_a_terminal_it_draws_in_place_and_without_colour(tmp_path):
    path = tmp_path / "run.h5"
    with LogWriter.create(path, [Channel("theta_x", "rad", "output", "theta_x", 1e4)], test="chop", bench={}) as log:
        log.append({"theta_x": 1e-3 * np.sin(np.linspace(0.0, 20.0, 1000))})
    ours, theirs = os.openpty()
    process = subprocess.Popen(
        [*running.MCCD, "watch", str(path)],
        cwd=ROOT,
        stdout=theirs,
        stderr=subprocess.PIPE,
        env=os.environ | {"TERM": "xterm", "NO_COLOR": "1", "COLUMNS": "100"},
    )
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # how Linux says that nobody writes any more
        while part := os.read(ours, 65536):
            shown += part
    os.close(ours)
    assert process.wait(timeout=30) == 0
    assert process.stderr is not None and b"the run is complete" in process.stderr.read()
    process.stderr.close()
    text = shown.decode()
    assert "complete" in text and "theta_x" in text and "█" in text
    assert not re.search(r"\x1b\[[0-9;]*m", text.replace("\x1b[0m", ""))


ABSURD = {"nan": np.nan, "inf": np.inf, "-inf": -np.inf, "1e300": 1e300, "1.7e308": 1.7e308}


@pytest.mark.parametrize("absurd", ABSURD)
@pytest.mark.parametrize("rows", [slice(15_000, 15_300), slice(-1, None), slice(None)])
def test_readings_that_are_none_leave_gaps(tmp_path, capsys, absurd, rows):
    path = tmp_path / "run.h5"
    driven = 1e-4 * np.random.default_rng(0).standard_normal(30_000)
    angle = driven.copy()
    angle[rows] = ABSURD[absurd]
    if absurd == "1.7e308":
        angle[rows] *= (-1.0) ** np.arange(angle[rows].size)  # the range is beyond what a float holds
    channels = [
        Channel("command_theta_x", "N m", "input", "theta_x", 1e4),
        Channel("theta_x", "rad", "output", "theta_x", 1e4),
    ]
    with LogWriter.create(path, channels, test="t", bench={}) as log, log.segment("a", {}):
        log.append({"command_theta_x": driven, "theta_x": angle})
    (tmp_path / "model.toml").write_text(dump_model(bench_model()), encoding="utf-8")

    there = angle[10_000:][np.abs(angle[10_000:]) < 1.0]  # the last two seconds are shown
    watch = ["watch", str(path), "--once", "--model", str(tmp_path / "model.toml")]
    with warnings.catch_warnings(action="error"):
        for command in (watch, ["watch", str(path)], ["log", "check", str(path)], ["log", "summary", str(path)]):
            assert main(command) == 0
        capsys.readouterr()
        assert main([*watch, "--json"]) == 0
    seen = json.loads(capsys.readouterr().out)
    (reading,), (misfit,) = seen["readings"], seen["misfits"]
    assert reading["low"] == (there.min() if there.size else None)
    assert reading["high"] == (there.max() if there.size else None)
    assert reading["last"] == (angle[-1] if abs(angle[-1]) < 1.0 else None)
    assert (misfit["residual_rms"] is None) == (there.size == 0)
