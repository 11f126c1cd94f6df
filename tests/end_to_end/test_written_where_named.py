"""Commands write into the folder that was named: not through links that stand there, and not where a file points."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from analysis.challenge.run import cases_of, run_challenge
from analysis.challenge.truth import Truth, seal
from campaigns.serial.ports import PtyPort
from mccdcli.main import main
from sim_backend.errors import ConfigError
from tests.analysis.study.studies import SPREAD

CAMPAIGN = """
schema = "mccd-campaign/1"
name = "one"
[[runs]]
name = "stops"
plan = "endstops"
settings = { ramp_s = 0.02, settle_s = 0.02, hold_s = 0.02 }
"""
NOT_TEXT = os.fsdecode(b"x\xff")


@pytest.fixture
def victim(tmp_path: Path) -> Path:
    """A file outside the folders that are written into, to which links lead."""
    path = tmp_path / "victim"
    path.write_text("precious")
    return path


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder with results, which is the current one."""
    path = tmp_path / "folder"
    path.mkdir()
    monkeypatch.chdir(path)
    return path


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "..", ".x", "a\\\\b", "a\\u0000b", "x" * 101])
def test_a_study_and_a_campaign_name_no_folder_elsewhere(folder, capsys, name):
    Path("study.toml").write_text(SPREAD.format(trials=1).replace('"spread"', f'"{name}"', 1))
    Path("campaign.toml").write_text(CAMPAIGN.replace('"one"', f'"{name}"', 1))
    Path("run.toml").write_text(CAMPAIGN.replace('"stops"', f'"{name}"', 1))
    for command in (["study", "study.toml"], ["campaign", "run", "campaign.toml"], ["campaign", "run", "run.toml"]):
        assert main(command) == 2
        said = capsys.readouterr().err
        assert "cannot be a name: use 1 to 100 bytes" in said and said.count("\n") == 1
    assert sorted(os.listdir()) == ["campaign.toml", "run.toml", "study.toml"]


def test_the_lock_of_a_campaign_follows_no_link(folder, victim, capsys):
    Path("campaign.toml").write_text(CAMPAIGN)
    Path("one").mkdir()
    Path("one/.campaign.lock").symlink_to(victim)
    assert main(["campaign", "run", "campaign.toml"]) == 2
    assert ".campaign.lock is a link, and a lock follows none; remove it" in capsys.readouterr().err
    assert victim.read_text() == "precious"
    assert os.listdir("one") == [".campaign.lock"]


def test_the_files_of_a_campaign_follow_no_link(folder, victim):
    Path("campaign.toml").write_text(CAMPAIGN)
    Path("one").mkdir()
    Path("one/stops.h5.sha256").symlink_to(victim)
    Path("one/campaign.json").symlink_to(victim.with_name("absent"))
    assert main(["campaign", "run", "campaign.toml"]) == 0
    assert victim.read_text() == "precious"
    assert not victim.with_name("absent").exists()
    assert not any(path.is_symlink() for path in Path("one").iterdir())


def test_the_files_of_a_study_follow_no_link(folder, victim, capsys):
    Path("study.toml").write_text(SPREAD.format(trials=1))
    Path("spread").mkdir()
    Path("spread/trials.sqlite").symlink_to(victim.with_name("absent"))
    assert main(["study", "study.toml"]) == 2
    assert "trials.sqlite is a link" in capsys.readouterr().err
    assert not victim.with_name("absent").exists()
    Path("spread/trials.sqlite").unlink()
    for name in ("trials.csv", "study.json", "study.svg", ".study.json.tmp", ".trials.csv.tmp"):
        Path("spread", name).symlink_to(victim)
    assert main(["study", "study.toml"]) == 0
    assert victim.read_text() == "precious"
    assert not any(Path("spread", name).is_symlink() for name in ("trials.csv", "study.json", "study.svg"))


def test_a_model_follows_no_link(folder, victim):
    for name in ("model.toml", ".model.toml.tmp"):
        Path(name).symlink_to(victim)
    assert main(["model", "convert", "design", "-o", "model.toml", "--force"]) == 0
    assert victim.read_text() == "precious"
    assert 'name = "design"' in Path("model.toml").read_text()


def test_the_results_of_a_challenge_follow_no_link(folder, victim):
    seal(folder, Truth(seed=0, salt="", cases={}))
    Path("challenge.json").write_text(json.dumps({"cases": ["0001"]}))
    Path("cases/0001").mkdir(parents=True)
    Path("results/0001").mkdir(parents=True)
    for name in ("words.txt", ".run.json"):
        Path("results/0001", name).symlink_to(victim)
    Path("results/0001/run.json").symlink_to(victim.with_name("absent"))
    run_challenge(folder, command=("true",))
    assert victim.read_text() == "precious"
    assert [Path("results/0001", name).is_symlink() for name in ("words.txt", "run.json")] == [False, False]
    Path("challenge.json").write_text(json.dumps({"cases": ["../../x"]}))
    with pytest.raises(ConfigError, match=r"case '\.\./\.\./x' cannot be a name"):
        cases_of(folder)


def test_a_terminal_replaces_no_link_but_that_of_a_terminal(folder, victim):
    Path("mine").symlink_to(victim)
    with pytest.raises(ConfigError, match="exists and is not a symbolic link to a terminal"):
        PtyPort(Path("mine"))
    assert Path("mine").readlink() == victim
    Path("left").symlink_to("/dev/pts/987654321")
    port = PtyPort(Path("left"))
    line = port.accept()
    assert line is not None and Path("left").readlink() != Path("/dev/pts/987654321")
    line.close()
    port.close()
    assert not os.path.lexists("left")


@pytest.mark.parametrize(
    "arguments",
    [
        ["campaign", "run", "quick", "--out", NOT_TEXT],
        ["chop", "-o", f"{NOT_TEXT}.h5"],
        ["log", "export", __file__, "-o", f"{NOT_TEXT}.csv"],
        ["model", "convert", "design", "-o", f"{NOT_TEXT}.json"],
        ["identify", "--plot", f"{NOT_TEXT}.png"],
        ["bench", "serve", "--link", NOT_TEXT],
        ["challenge", "make", NOT_TEXT],
    ],
)
def test_a_name_to_write_is_text(folder, capsys, arguments):
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert "UTF-8" in said and said.count("\n") == 1
    assert os.listdir() == []
