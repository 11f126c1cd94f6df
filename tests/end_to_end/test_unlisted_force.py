"""A force that no library lists, recorded by another process: the command line says *unknown*, and where it acts."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.end_to_end.strange_bench import DECAY_1_S, FREQUENCY_HZ, LEVELS, PERIOD, PERIODS, RATE_HZ
from tests.end_to_end.unknown_bench import mccd

ROWS = PERIOD * PERIODS
MAP = f"""
[log]
test = "multisine"
source = "data.csv"
sample_rate_hz = {RATE_HZ}
period = {PERIOD}
[channels.drive]
select = "u"
unit = "V"
role = "input"
dof = "x"
[channels.position]
select = "y"
unit = "m"
role = "output"
dof = "x"
[segments]
""" + "\n".join(
    f'"{"held-out " if k == len(LEVELS) - 1 else ""}level {level}" = [{k * ROWS}, {(k + 1) * ROWS}]'
    for k, level in enumerate(LEVELS)
)
# the numbers of a drawing, two per cent off
NOMINAL = f"""
schema = "mccd-model/1"
name = "nominal"
sample_rate_hz = {RATE_HZ}
inputs = [{{ name = "drive", unit = "V", dof = "x" }}]
outputs = [{{ name = "position", unit = "m", dof = "x" }}]
[[modes]]
label = "suspension"
frequency_hz = {1.02 * FREQUENCY_HZ}
decay_rate_1_s = {0.98 * DECAY_1_S}
input.drive = 22740.0
output.position = 1.0
"""


def _diagnosed(folder: Path, strength: float, *, identified: bool) -> dict:  # type: ignore[type-arg]
    bench = [sys.executable, "-m", "tests.end_to_end.strange_bench", str(folder / "data.csv"), str(strength)]
    subprocess.run(bench, check=True, timeout=120)
    (folder / "map.toml").write_text(MAP, encoding="utf-8")
    done = mccd(folder, "import", "map.toml", "-o", "run.h5")
    assert done.returncode == 0, done.stderr
    if identified:
        done = mccd(folder, "identify", "--log", "run.h5", "--modes", "1", "-o", "nominal.toml")
        assert done.returncode == 0, done.stderr
    else:
        (folder / "nominal.toml").write_text(NOMINAL, encoding="utf-8")
    done = mccd(folder, "diagnose", "run.h5", "--model", "nominal.toml", "-o", "out", "--json")
    assert done.returncode in (0, 1), done.stderr
    return dict(json.loads(done.stdout), exit_code=done.returncode)


@pytest.mark.parametrize(("strength", "identified"), [(0.003, False), (0.1, True)])
def test_a_force_that_is_no_listed_cause_gets_no_name(tmp_path: Path, strength: float, identified: bool) -> None:
    """One per cent of the motion against a drawing, a quarter of it against a model fitted to the same record."""
    found = _diagnosed(tmp_path, strength, identified=identified)
    assert (found["verdict"], found["exit_code"]) == ("unknown", 1), found["sentence"]
    assert found["causes"] == []
    assert "at x" in " ".join(found["notes"])


def test_without_it_the_same_bench_is_consistent(tmp_path: Path) -> None:
    assert _diagnosed(tmp_path, 0.0, identified=False)["verdict"] == "consistent"
