"""A folder of results that the user has not named is no link: whoever packed the files may have laid it."""

from __future__ import annotations

from pathlib import Path

import pytest

from mccdcli.main import main

STUDY = """schema = "mccd-study/1"
name = "small"
title = "t"
kind = "settling"
model = "as-built"
trials = 2
seed = 1
[settings]
cycles = 2
[[vary]]
place = "model.modes[*].frequency_hz"
relative = true
normal = { std = 0.002 }
"""

CAMPAIGN = """schema = "mccd-campaign/1"
name = "small"
[[runs]]
name = "a"
plan = "hysteresis"
settings = { torques_nm = [0.05, 0.08] }
"""


@pytest.mark.parametrize("inside", ["campaign", "designed"])
def test_a_link_within_the_folder_of_a_report_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], inside: str
) -> None:
    here, elsewhere = tmp_path / "here", tmp_path / "elsewhere"
    (here / "mine").mkdir(parents=True)
    elsewhere.mkdir()
    (here / "mine" / inside).symlink_to(elsewhere)
    monkeypatch.chdir(here)
    assert main(["report", "-o", "mine"]) == 2
    assert "is a link or a file" in capsys.readouterr().err
    assert list(elsewhere.iterdir()) == []


@pytest.mark.parametrize(
    ("folder", "arguments"),
    [
        ("small", ["study", "study.toml"]),
        ("small", ["campaign", "run", "campaign.toml"]),
        ("report", ["report"]),
        ("design", ["design", "--model", "as-built", "--unswept"]),
        ("thermal", ["thermal"]),
    ],
)
def test_a_link_in_place_of_a_default_folder_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    folder: str,
    arguments: list[str],
) -> None:
    here, elsewhere = tmp_path / "here", tmp_path / "elsewhere"
    here.mkdir()
    elsewhere.mkdir()
    (here / "study.toml").write_text(STUDY)
    (here / "campaign.toml").write_text(CAMPAIGN)
    (here / folder).symlink_to(elsewhere)
    monkeypatch.chdir(here)
    assert main(arguments) == 2
    assert "is a link or a file" in capsys.readouterr().err
    assert list(elsewhere.iterdir()) == []
