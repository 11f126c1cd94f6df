"""Two measured water tanks, one of which overflows: import, identify and diagnose, all by commands.

Where a tank overflows, the level reads 10 V: such samples are no measurement. The outflow follows the square root of
the level, which no effect of the library is, so that nothing but a saturation may be named.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from analysis.diagnosis.records.loading import load_runs
from campaigns.facts import measured_segments
from campaigns.log import read_run
from sim_backend.model import load_model
from tests.end_to_end.unknown_bench import mccd
from tests.measured import TANKS, needs_tanks

EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "examples" / "tanks-import.toml"
FULL_V = 10.0
PARTS = {"estimation": "4.59 %", "held-out validation": "3.61 %"}
"""Labels, and the part of their samples that reads ten volts, counted in the file by hand."""

pytestmark = [pytest.mark.slow, needs_tanks]


@pytest.fixture(scope="module")
def tanks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with tanks.h5, as the map of the examples makes it, tanks.toml, and what the commands said."""
    folder = tmp_path_factory.mktemp("tanks")
    (folder / "dataBenchmark.csv").symlink_to(TANKS / "dataBenchmark.csv")
    (folder / "map.toml").write_text(EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    commands = {
        "import": ["map.toml", "-o", "tanks.h5", "--allow-outside"],  # the data are a link
        "identify": ["--log", "tanks.h5", "-o", "tanks.toml", "--json"],
    }
    for name, arguments in commands.items():
        done = mccd(folder, name, *arguments)
        assert done.returncode == 0, done.stderr
        (folder / f"{name}.txt").write_text(done.stdout, encoding="utf-8")
    return folder


def test_the_import_says_what_is_cut_off_in_each_part(tanks: Path) -> None:
    said = (tanks / "import.txt").read_text(encoding="utf-8")
    assert "2048 samples at 0.25 Hz" in said
    for label, part in PARTS.items():
        assert f'level is cut off at 10 V in {part} of the samples of "{label}"' in said


def test_cut_off_samples_are_in_no_fit(tanks: Path) -> None:
    with read_run(tanks / "tanks.h5") as run:
        level = run.read("level")
        assert np.sum(level >= FULL_V) > 50
        segments = [s for s in measured_segments(run) if s.rows]
        assert {s.label.split(",")[0] for s in segments} >= set(PARTS)
        assert all(np.all(level[s.start : s.stop] < FULL_V) for s in segments)
    loaded = load_runs([tanks / "tanks.h5"], load_model(tanks / "tanks.toml"))
    for record in loaded.data.records:
        used = record.fitted() | record.held_out()
        assert np.all(record.y[used] < FULL_V)


def test_a_model_is_identified_and_tried_on_the_validation(tanks: Path) -> None:
    fitted = json.loads((tanks / "identify.txt").read_text(encoding="utf-8"))["identification"]
    assert load_model(tanks / "tanks.toml").modes
    assert {one["segment"].split(" (")[0] for one in fitted["held_out"]} == {"held-out validation"}
    # a mean level predicts nothing: whatever is better has an error below one
    assert all(one["total"] < 1.0 for one in fitted["held_out"])


def test_nothing_but_a_saturation_is_named(tanks: Path) -> None:
    done = mccd(tanks, "diagnose", "tanks.h5", "--model", "tanks.toml", "-o", "out", "--json", "--no-page")
    assert done.returncode == 1, done.stderr
    found = json.loads(done.stdout)
    named = {cause["effect"] for cause in found["causes"]}
    assert found["verdict"] == "unknown" or (named and all("saturation" in name for name in named))
    assert any("cut off at 10 V" in note for note in found["notes"])
