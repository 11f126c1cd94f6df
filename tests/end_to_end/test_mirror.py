"""A measured mirror as its user has it: bundled map beside the data, import, identify, all from the command line."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data" / "fsm"
PUBLISHED_200_MV = 0.0795
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not DATA.is_dir(), reason=f"measured mirror data are not at {DATA}"),
]


def mccd(folder: Path, *arguments: str, expected: int = 0) -> str:
    environment = os.environ | {"HOME": str(folder), "XDG_STATE_HOME": str(folder)}
    done = subprocess.run(
        [sys.executable, "-m", "mccdcli", *arguments],
        cwd=folder,
        env=environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == expected, done.stderr
    return done.stdout


def test_map_import_and_identification_of_one_level(tmp_path):
    for file in DATA.glob("*.npy"):
        (tmp_path / file.name).symlink_to(file)
    (tmp_path / "map.toml").write_text((ROOT / "docs" / "examples" / "fsm-import.toml").read_text())
    mccd(tmp_path, "import", "map.toml", "-o", "fsm.h5")
    options = ("--only", "200 mV", "--modes", "14", "--equal-weights", "--response", "r.csv", "--json")
    found = json.loads(mccd(tmp_path, "identify", "--log", "fsm.h5", *options, "-o", "m.toml"))["identification"]
    errors = [one["total"] for one in found["held_out"] if "200 mV" in one["segment"]]
    assert len(errors) == 3
    assert np.sqrt(np.mean(np.square(errors))) < PUBLISHED_200_MV
    # its README calls the mirror weakly nonlinear: the distortion stands above the noise, and below the linear error
    assert found["noise"] < found["distortion"] < PUBLISHED_200_MV
    with (tmp_path / "r.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len({(row["output"], row["input"]) for row in rows}) == 9
    assert all(0.0 < float(row["std"]) < np.inf for row in rows)


def test_hysteresis_is_named_and_takes_two_fifths_of_the_error(tmp_path):
    for file in DATA.glob("*.npy"):
        (tmp_path / file.name).symlink_to(file)
    (tmp_path / "map.toml").write_text((ROOT / "docs" / "examples" / "fsm-import.toml").read_text())
    mccd(tmp_path, "import", "map.toml", "-o", "fsm.h5")
    mccd(tmp_path, "identify", "--log", "fsm.h5", "--modes", "16", "--equal-weights", "-o", "m.toml")
    found = json.loads(mccd(tmp_path, "diagnose", "fsm.h5", "--model", "m.toml", "-o", "out", "--json", expected=1))
    assert found["verdict"] == "named"
    assert {(c["effect"], c["where"]) for c in found["causes"]} == {("hysteresis", f"piezo_{i}") for i in (1, 2, 3)}
    # a linear model of all three levels misses them by 18.6, 6.6 and 16.3 % (published); far less needs the cause
    assert found["gain"]["rms_after"] < 0.6 * found["gain"]["rms_before"]
