"""A force that no library lists, recorded by another process: the command line says *unknown*, and where it acts."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.end_to_end.strange_bench import DECAY_1_S, FREQUENCY_HZ, LEVELS, PERIOD, PERIODS, RATE_HZ
from tests.end_to_end.unknown_bench import diagnosis, identified, imported, write_map

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


def recorded(folder: Path, bench: str, *numbers: float) -> None:
    """Turn what the process `bench` of this folder plays into run.h5, its last level held out."""
    command = [sys.executable, "-m", f"tests.end_to_end.{bench}", str(folder / "data.csv"), *map(str, numbers)]
    subprocess.run(command, check=True, timeout=120)
    parts = [(f"level {level}", PERIOD * PERIODS) for level in LEVELS]
    parts[-1] = (f"held-out {parts[-1][0]}", parts[-1][1])
    write_map(folder, RATE_HZ, parts, PERIOD)
    imported(folder)


def _diagnosed(folder: Path, strength: float, *, from_data: bool) -> dict:  # type: ignore[type-arg]
    recorded(folder, "strange_bench", strength)
    if from_data:
        identified(folder, "--modes", "1")
    else:
        (folder / "nominal.toml").write_text(NOMINAL, encoding="utf-8")
    return diagnosis(folder)


@pytest.mark.parametrize(("strength", "from_data"), [(0.003, False), (0.1, True)])
def test_a_force_that_is_no_listed_cause_gets_no_name(tmp_path: Path, strength: float, from_data: bool) -> None:
    """One per cent of the motion against a drawing, a quarter of it against a model fitted to the same record."""
    found = _diagnosed(tmp_path, strength, from_data=from_data)
    assert (found["verdict"], found["exit_code"]) == ("unknown", 1), found["sentence"]
    assert found["causes"] == []
    assert "at x" in " ".join(found["notes"])


def test_without_it_the_same_bench_is_consistent(tmp_path: Path) -> None:
    assert _diagnosed(tmp_path, 0.0, from_data=False)["verdict"] == "consistent"
