"""A measured mirror as its user has it: bundled map beside the data, import, identify, diagnose, all by commands."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import running
from tests.measured import MIRROR, needs_mirror

ROOT = Path(__file__).resolve().parents[2]
PUBLISHED_200_MV = 0.0795
pytestmark = [pytest.mark.slow, needs_mirror]

ONE_LINEAR_MODEL = {"100 mV": 0.186, "200 mV": 0.066, "300 mV": 0.163}
"""Published errors of one linear model of all three levels on the test records, rms over the rms of the output."""

AIMED_AT = {"100 mV": 0.10, "200 mV": 0.06, "300 mV": 0.07}
"""What correcting the model by a physical cause is to reach there; a neural model has 6.4, 4.8 and 4.2 %."""


def mccd(folder: Path, *arguments: str, expected: int = 0) -> str:
    home = {"HOME": str(folder), "XDG_STATE_HOME": str(folder)}
    done = running.mccd(*arguments, cwd=folder, env=home, timeout=900)
    assert done.returncode == expected, done.stderr
    return done.stdout


def imported(folder: Path) -> None:
    """Turn the measured arrays into fsm.h5 by the map of the examples."""
    for file in MIRROR.glob("*.npy"):
        (folder / file.name).symlink_to(file)
    (folder / "map.toml").write_text((ROOT / "docs" / "examples" / "fsm-import.toml").read_text())
    mccd(folder, "import", "map.toml", "-o", "fsm.h5", "--allow-outside")  # the data are links


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The diagnosis of all three levels by one linear model of them; it takes minutes."""
    folder = tmp_path_factory.mktemp("mirror")
    imported(folder)
    mccd(folder, "identify", "--log", "fsm.h5", "--modes", "16", "--equal-weights", "-o", "m.toml")
    return json.loads(mccd(folder, "diagnose", "fsm.h5", "--model", "m.toml", "-o", "out", "--json", expected=1))


def errors(found: dict[str, Any], level: str) -> tuple[float, float]:
    """Return the error before and after over the held-out segments of a level, which are of one length."""
    own = [one for one in found["segments"] if f"held-out {level} " in one["segment"]]
    assert own, [one["segment"] for one in found["segments"]]
    before, after = (np.sqrt(np.mean([one[key] ** 2 for one in own])) for key in ("rms_before", "rms_after"))
    return float(before), float(after)


def test_map_import_and_identification_of_one_level(tmp_path):
    imported(tmp_path)
    options = ("--only", "200 mV", "--modes", "14", "--equal-weights", "--response", "r.csv", "--json")
    fitted = json.loads(mccd(tmp_path, "identify", "--log", "fsm.h5", *options, "-o", "m.toml"))["identification"]
    totals = [one["total"] for one in fitted["held_out"] if "200 mV" in one["segment"]]
    assert len(totals) == 3
    assert np.sqrt(np.mean(np.square(totals))) < PUBLISHED_200_MV
    # its README calls the mirror weakly nonlinear: the distortion stands above the noise, and below the linear error
    assert fitted["noise"] < fitted["distortion"] < PUBLISHED_200_MV
    with (tmp_path / "r.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len({(row["output"], row["input"]) for row in rows}) == 9
    assert all(0.0 < float(row["std"]) < np.inf for row in rows)


def test_hysteresis_is_named_and_that_modes_soften_and_both_take_half_of_the_error(found: dict[str, Any]) -> None:
    assert found["verdict"] == "named"
    named = {(c["effect"], c["where"]) for c in found["causes"]}
    inside = {where for effect, where in named if effect == "slow-softening"}
    assert named - {("slow-softening", where) for where in inside} == {("hysteresis", f"piezo_{i}") for i in (1, 2, 3)}
    assert len(inside) > 8 and all(where.startswith("mode ") for where in inside)
    # a linear model of all three levels misses them by far more than noise; far less needs the cause
    assert found["gain"]["rms_after"] < 0.5 * found["gain"]["rms_before"]


@pytest.mark.parametrize("level", ONE_LINEAR_MODEL)
def test_no_level_is_worse_than_the_published_linear_model_of_all(level: str, found: dict[str, Any]) -> None:
    _, after = errors(found, level)
    assert after < ONE_LINEAR_MODEL[level]


@pytest.mark.parametrize("level", ONE_LINEAR_MODEL)
def test_every_level_gains(level: str, found: dict[str, Any]) -> None:
    before, after = errors(found, level)
    assert after < before


@pytest.mark.parametrize("level", AIMED_AT)
def test_every_level_is_predicted_as_well_as_was_aimed_at(level: str, found: dict[str, Any]) -> None:
    _, after = errors(found, level)
    assert after <= AIMED_AT[level]
