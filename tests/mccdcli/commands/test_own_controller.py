"""A designed strategy without a controller: designed from the bench's own logs, said, kept, and used again."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from campaigns.log import read_run
from campaigns.plans import make_plan
from campaigns.serial import EmulatorProcess, ServeOptions
from campaigns.strategies.controller import load_controller
from mccdcli.main import main
from mccdcli.own_controller import told_to_design_anew
from sim_backend.errors import CheckError
from sim_backend.model import dump_model
from tests.kept import ANALYSED, kept
from tests.shifted_bench import shifted_bench
from tests.small_bench import NOISE, bench_model

LATE: dict[str, Any] = {"delay_samples": 1.3, "amplifier_hz": 2000.0}
"""What a model of the bench as built lacks, and sweeps of this one show: parts of a sample, and an amplifier's pole."""


def chopped(folder: Path) -> None:
    """Chop a bench that nobody has a controller for, in a folder of its own."""
    bench = folder / "late.toml"
    bench.write_text(dump_model(shifted_bench(-0.01, **LATE)), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        code = main(["settle", "--strategy", "designed", "--alpha", "0", "--bench", "sim:late.toml", "--json"])
    (folder / "code").write_text(str(code), encoding="utf-8")


@pytest.fixture(scope="module")
def home() -> Path:
    return kept("own-controller", chopped, of=ANALYSED, recipe=Path(__file__).read_text(encoding="utf-8"))


def test_it_is_designed_from_the_benchs_own_logs_and_meets_what_is_required(home):
    # identify, design and chop, on a bench whose modes, delay and amplifier nobody told
    assert (home / "code").read_text(encoding="utf-8") == "0"
    folder = home / "designed-late"
    made = load_controller(folder / "controller.toml")
    assert {one.dof for one in made.axes} == {"theta_x", "theta_y"}
    logs = {"sweep-theta_x", "sweep-theta_y", "rest", "hysteresis-theta_x", "hysteresis-theta_y"}
    assert {path.stem for path in folder.glob("*.h5")} == logs
    assert json.loads((folder / "design.json").read_text(encoding="utf-8"))["controller"] == "controller.toml"
    with read_run(home / "settling.h5") as run:
        assert run.status == "complete" and run.segments[-1].settings["strategy"] == "designed"


def linked(home: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stand in an empty folder that holds the kept one and its bench."""
    (here / "late.toml").write_bytes((home / "late.toml").read_bytes())
    (here / "designed-late").mkdir()
    for name in ("controller.toml", "campaign.json"):
        (here / "designed-late" / name).write_bytes((home / "designed-late" / name).read_bytes())
    monkeypatch.chdir(here)


def test_it_is_used_the_next_time_and_said(home, tmp_path, monkeypatch, capsys):
    linked(home, tmp_path, monkeypatch)
    before = (tmp_path / "designed-late" / "controller.toml").read_bytes()
    given = ["chop", "--strategy", "designed", "--bench", "sim:late.toml", "--seed", "5"]
    assert main([*given, "--cycles", "2", "--set", "tuning.learning_s=4.0"]) in (0, 1)
    assert "designed-late/controller.toml is played, designed before for this bench" in capsys.readouterr().err
    assert (tmp_path / "designed-late" / "controller.toml").read_bytes() == before
    with read_run(tmp_path / "chop.h5") as run:
        assert run.status == "complete"


def test_that_of_another_bench_is_not(home, tmp_path, monkeypatch, capsys):
    linked(home, tmp_path, monkeypatch)
    (tmp_path / "late.toml").write_text(dump_model(shifted_bench(0.002, **LATE)), encoding="utf-8")
    assert main(["chop", "--strategy", "designed", "--bench", "sim:late.toml"]) == 2
    assert "was designed for another bench" in capsys.readouterr().err
    assert not (tmp_path / "chop.h5").exists()


@pytest.fixture
def units(tmp_path: Path) -> Iterator[list[str]]:
    """Return the addresses of two benches of one model behind lines of their own, with serial numbers of their own."""
    (tmp_path / "small.toml").write_text(dump_model(bench_model(NOISE)), encoding="utf-8")
    served: list[EmulatorProcess] = []
    try:
        for seed in (5, 6):
            served.append(EmulatorProcess(ServeOptions(bench=f"sim:{tmp_path / 'small.toml'}", seed=seed)))
        yield [one.address for one in served]
    finally:
        for one in served:
            one.close()


def test_two_units_of_one_model_share_no_controller(units, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(
        'schema = "mccd-campaign/1"\nname = "mine"\n[[runs]]\nname = "rest"\nplan = "rest"\n'
        "settings = { duration_s = 0.5 }\n"
    )
    folder = tmp_path / "designed-small"
    assert main(["campaign", "run", "mine.toml", "--bench", units[0], "--out", str(folder)]) == 0
    (folder / "controller.toml").write_text("that of the first unit")
    given = ["chop", "--strategy", "designed", "--dry-run", "--bench"]
    capsys.readouterr()
    # it is no controller, and that is what is said where it is taken
    assert main([*given, units[0]]) == 2
    said = capsys.readouterr().err
    assert "is played, designed before for this bench" in said and "another bench" not in said
    assert main([*given, units[1]]) == 2
    said = capsys.readouterr().err
    assert "was designed for another bench (serial was 'seed-5' and is 'seed-6')" in said
    assert "move designed-small away to identify this bench and design anew" in said and "is played" not in said
    (folder / "rest.h5").unlink()
    assert main([*given, units[0]]) == 2
    assert "has no log left that says whether" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("controller", "advice"),
    [
        (
            "designed-late/controller.toml",
            ": the controller is kept in designed-late; move it away to identify and design anew",
        ),
        ("design/controller.toml", ""),
    ],
)
def test_a_stopped_chop_says_which_folder_stands_in_the_way(controller: str, advice: str) -> None:
    plan = make_plan("chop", {"strategy": "designed", "controller": controller})
    with pytest.raises(CheckError) as stopped, told_to_design_anew(plan):
        raise CheckError("cycle 3 strays; design anew")
    assert str(stopped.value) == f"cycle 3 strays; design anew{advice}"


def test_a_dry_run_counts_what_would_be_measured_and_measures_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["settle", "--strategy", "designed", "--dry-run", "--json"]) == 0
    said = capsys.readouterr()
    assert set(json.loads(said.out)["runs"]) >= {"sweep-theta_x", "rest", "hysteresis-theta_y"}
    assert "would first be designed in designed-as-built" in said.err and list(tmp_path.iterdir()) == []


def test_settings_that_cannot_be_are_refused_before_anything_is_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["settle", "--strategy", "designed", "--set", "cycles=0"]) == 2
    assert "cycles is 0" in capsys.readouterr().err and list(tmp_path.iterdir()) == []
