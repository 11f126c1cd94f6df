"""Readings that are none, off a real line, into every command that measures: a clear error, and the log stays."""

from __future__ import annotations

import subprocess
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from campaigns.benches import open_bench
from campaigns.log import read_run, verify
from sim_backend.bench import Array
from tests import running
from tests.campaigns.serial.hostile import BendReading, BentBench, BentFirmware, faithful, served

BAND = "bands=[{start_hz=10.0,stop_hz=40.0,step_hz=10.0,settle_s=0.1}]"
COMMANDS: dict[str, tuple[list[str], str]] = {
    "identify": (["--axis", "theta_x", "--set", BAND, "--logs", "logs", "-o", "nominal.toml"], "logs"),
    "chop": (["--cycles", "2", "-o", "run.h5"], "."),
    "settle": (["--cycles", "3", "-o", "run.h5"], "."),
    "theodolite": (["--set", "x_rad=[-6e-3,0.0,6e-3]", "--set", "y_rad=[-6e-3,0.0,6e-3]", "-o", "run.h5"], "."),
    "endstops": (["--set", "settle_s=0.3", "--set", "hold_s=0.3", "-o", "run.h5"], "."),
    "thermal": (["--no-sweeps", "--set", "cycles=4", "-o", "logs"], "logs"),
    "hysteresis": (["--set", "torques_nm=[0.08]", "--set", "frequency_hz=1.0", "-o", "run.h5"], "."),
}
"""A short run of each, and the folder of its logs."""

CHOPS = ("chop", "settle", "thermal")
"""A chop is judged cycle by cycle, and stopped where its axes cannot be seen."""


def lost(_name: str, values: Array) -> Array:
    values[np.random.default_rng(0).random(values.size) < 0.01] = np.nan
    return values


def endless(_name: str, values: Array) -> Array:
    return np.full_like(values, np.inf)


def huge(_name: str, values: Array) -> Array:
    return values * 1e300


def at_rest(name: str, values: Array) -> Array:
    return np.zeros_like(values) if name.startswith("theta") else values


def run(command: str, bend: BendReading, folder: Path) -> subprocess.CompletedProcess[str]:
    """Play a short run of a command on a bench with such readings."""
    arguments, logs = COMMANDS[command]
    firmware = BentFirmware(BentBench(open_bench("sim", 1), bend), faithful)
    with served(firmware) as address:
        done = running.mccd(command, *arguments, "--bench", address, cwd=folder)
    kept = sorted((folder / logs).rglob("*.h5"))
    assert len(kept) == 1 and verify(kept[0]).ok
    with read_run(kept[0]) as log:
        assert log.rows > 0  # whatever it is worth, what was measured is kept
        assert log.status == ("failed" if done.returncode == 1 else "complete")
    return done


@pytest.mark.parametrize(("command", "bend"), [("identify", endless), *product(COMMANDS, (lost, huge))])
def test_readings_that_are_none_end_in_one_line(tmp_path: Path, command: str, bend: BendReading) -> None:
    done = run(command, bend, tmp_path)
    stopped = bend is huge and command in CHOPS
    assert done.returncode == (1 if stopped else 4), done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith("mccd: error:")]
    assert len(lines) == 1 and "Warning" not in done.stderr and "Traceback" not in done.stderr
    said = ("beyond what any sensor reads", "beyond its reach") if bend is huge else ("not finite", "holds no number")
    assert any(words in lines[0] for words in said)


def test_a_mirror_that_does_not_move_has_no_loops(tmp_path: Path) -> None:
    done = run("hysteresis", at_rest, tmp_path)
    assert done.returncode == 4 and "the angle stays at 0 rad" in done.stderr, done.stderr
