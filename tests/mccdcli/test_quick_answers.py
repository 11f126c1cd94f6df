"""What is answered without computing imports nothing that only computing needs: refusals, dry runs, a look at a log.

The modules are guarded, not the time: which of them are loaded does not depend on the machine.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from campaigns.log import Channel, LogWriter
from mccdcli.main import cli
from mccdcli.registry import COMMANDS
from mccdcli.settings import options_of

# numpy and msgspec are not among them: hardly an answer does without
HEAVY = {"control", "dask", "jinja2", "llvmlite", "matplotlib", "numba", "pandas", "rich", "xarray"} | {
    f"scipy.{part}" for part in ("fft", "integrate", "interpolate", "linalg", "optimize", "signal", "sparse", "stats")
}

# The reading and writing of logs, which nothing needs that only counts; and our own search and fits, half of the time
# of an answer that does not search
LOGS = {"h5py"}
SEARCH = {"analysis.diagnosis.fitting", "analysis.diagnosis.search", "analysis.identification"}

# Everything that says no before it computes, by command: wrong names, wrong settings, options that are missing or
# contradict each other. In a folder that holds study.toml, bad-study.toml, readings.csv, run.h5 and taken.toml.
REFUSED = {
    "bench check": ["", "--bench sim", "--bench nonsense"],
    "bench list": ["--nonsense"],
    "bench serve": ["--transport nonsense", "--model nonsense", "--faults nonsense"],
    "campaign list": ["--nonsense"],
    "campaign run": ["", "nonsense", "quick --bench sim:nonsense"],
    "campaign show": ["", "nonsense"],
    "challenge make": ["", "made --family nonsense", "made --shape nonsense", "made --one 0 --none 0", "full"],
    "challenge pool": ["", "nonsense.json"],
    "challenge run": ["nonsense", "full"],
    "challenge score": ["nonsense", "full"],
    "chop": [
        "--strategy nonsense",
        "--strategy designed --set nonsense=3",
        "--model nonsense",
        "--form nonsense",
        "--cycles 0",
        "--frequency -1",
        "--set nonsense=3",
        "--set nonsense",
        "--bench nonsense",
        "--bench sim:nonsense",
        "--dry-run --bench sim:nonsense",
        "--controller nonsense.toml",
    ],
    "compare": ["", "nonsense nonsense", "run.h5 design", "design nonsense.toml"],
    "completion": ["nonsense"],
    "config show": ["nonsense"],
    "design": ["", "--model nonsense", "--model nonsense --dry-run", "--model design --reach -1", "--log nonsense.h5"],
    "diagnose": ["run.h5", "nonsense.h5 --model design", "run.h5 --model nonsense", "run.h5 --model design --rows 1"],
    "endstops": ["--set nonsense=3", "--set current_a=-1", "--bench sim:nonsense"],
    "hysteresis": ["--set nonsense=3", "--axis nonsense", "--set model=nonsense", "--set frequency_hz=0"],
    "identify": ["--axis nonsense", "--set nonsense=3", "--modes 0", "--log nonsense.h5", "--out taken.toml"],
    "import": ["", "nonsense.toml"],
    "investigate": [
        "",
        "--model nonsense",
        "--model design --set cycles=3",
        "--model design --first nonsense",
        "--model design --first chop --set nonsense=3",
        "--model design --rounds 0",
        "--model design --dry-run --bench sim:nonsense --first rest",
    ],
    "log check": ["nonsense.h5"],
    "log export": ["run.h5", "nonsense.h5 --out a.csv"],
    "log list": ["", "nonsense", "run.h5", ". --status nonsense", ". --since nonsense"],
    "log plot": ["nonsense.h5"],
    "log recover": ["nonsense.h5"],
    "log show": ["nonsense.h5"],
    "log summary": ["nonsense.h5"],
    "log verify": ["nonsense.h5"],
    "manual": ["--format nonsense"],
    "model convert": ["nonsense --out a.toml", "design --out a.nonsense", "design --out taken.toml"],
    "model effects": ["nonsense"],
    "report": [
        "--campaign nonsense",
        "--dry-run --bench sim:nonsense",
        "--junit a.xml",
        "--known-misses study.toml",
        "--check --known-misses nonsense.toml",
        "--check --known-misses study.toml",
    ],
    "schema": ["nonsense"],
    "settle": [
        "--strategy designed --cycles 0",
        "--strategy nonsense",
        "--model nonsense",
        "--cycles 0",
        "--set nonsense=3",
    ],
    "simulate": ["--plan nonsense", "--model nonsense", "--set nonsense=3", "--waveform nonsense.csv"],
    "study": ["nonsense.toml", "bad-study.toml", "study.toml --workers 1 --cluster tcp://127.0.0.1:8786"],
    "theodolite": ["--set nonsense=3", "--readings nonsense.csv", "--bench sim:nonsense"],
    "thermal": ["--set nonsense=3", "--bench sim:nonsense"],
    "watch": ["", "run.h5 --model nonsense --once", "run.h5 --web --once", "run.h5 --port 8080"],
}

# What counts its steps, limits and bytes, by command: the calls, and what these may load all the same.
COUNTED: dict[str, list[tuple[str, set[str]]]] = {
    "campaign run": [("quick", set()), ("paper", set())],
    "chop": [("", set())],
    "design": [("--model design", set())],
    "endstops": [("", set())],
    "hysteresis": [("", set())],
    "identify": [("", set()), ("--axis theta_y", set())],
    "investigate": [
        ("--model design --first rest", set()),
        # the plan is found by playing multisines on paper, on a loop that may have to be compiled first
        ("--model design", {"llvmlite", "numba"} | {name for name in HEAVY if name.startswith("scipy.")}),
    ],
    "report": [("", set())],
    "settle": [("", set()), ("--strategy mbff", set()), ("--strategy repetitive", set())],
    "simulate": [("", set()), ("--plan sinesweep", set()), ("--plan multisine", set())],
    # a trial measures what it has played, as a log is measured
    "study": [("study.toml", LOGS)],
    "theodolite": [("", set())],
    "thermal": [("", set())],
}

STUDY = 'schema = "mccd-study/1"\nname = "small"\nkind = "settling"\ntrials = 3\n[settings]\ncycles = 2\n'

SCRIPT = """
import contextlib, io, json, sys
from mccdcli.main import main
heavy, found = set(json.loads(sys.argv[1])), []
for line in json.loads(sys.argv[2]):
    before, err = heavy & set(sys.modules), io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(err):
        code = main(line.split())
    found.append((line, code, sorted(heavy & set(sys.modules) - before), err.getvalue()))
print(json.dumps(found))
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "something").touch()
    (tmp_path / "taken.toml").touch()
    (tmp_path / "study.toml").write_text(STUDY)
    (tmp_path / "bad-study.toml").write_text(STUDY.replace("settling", "nonsense"))
    channels = [Channel("torque", "N m", "input", "x", 1e3), Channel("angle", "rad", "output", "x", 1e3)]
    with LogWriter.create("run.h5", channels, test="chop", bench={"kind": "sim"}) as log, log.segment("all"):
        log.append({"torque": [0.0, 1.0], "angle": [0.0, 0.1]})


def loaded_by(lines: list[str], heavy: set[str] = HEAVY) -> list[tuple[str, int, list[str], str]]:
    """Run the lines one after the other in a fresh interpreter: exit code, heavy modules that it loaded, and errors."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, json.dumps(sorted(heavy)), json.dumps(lines)],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return [tuple(each) for each in json.loads(done.stdout)]


def runs_dry(name: str) -> bool:
    command = cli.find(tuple(name.split()))
    assert command is not None
    return any(option == "dry-run" for option, _ in options_of(command))


def test_every_command_is_here() -> None:
    assert set(REFUSED) == set(COMMANDS)
    assert set(COUNTED) == {name for name in COMMANDS if runs_dry(name)}


def test_a_refusal_loads_nothing_heavy() -> None:
    lines = [f"{name} {rest}" for name, calls in REFUSED.items() for rest in calls]
    found = loaded_by(lines, HEAVY | SEARCH)
    assert [line for line, code, _, _ in found if code != 2] == []
    assert {line: loaded for line, _, loaded, _ in found if loaded} == {}
    # one line each, and no bug among them
    assert [err for _, _, _, err in found if err.count("\n") != 1 or not err.startswith("mccd: error: ")] == []


def test_a_dry_run_loads_nothing_heavy() -> None:
    # those that may load more come last, so that they do not hide what others load
    calls = [(f"{name} --dry-run {rest}", may) for name, all_of in COUNTED.items() for rest, may in all_of]
    calls.sort(key=lambda call: len(call[1]))
    found = loaded_by([line for line, _ in calls], HEAVY | LOGS | SEARCH)
    assert [(line, err) for line, code, _, err in found if code != 0] == []
    assert {line: set(new) - may for (line, _, new, _), (_, may) in zip(found, calls, strict=True)} == {
        line: set() for line, _ in calls
    }


def test_a_look_at_a_log_loads_nothing_heavy() -> None:
    found = loaded_by(
        ["log show run.h5", "log show run.h5 --json", "log list .", "log verify run.h5", "log summary run.h5"]
    )
    assert [(code, loaded) for _, code, loaded, _ in found] == [(0, [])] * 5
