"""A small challenge from the command line: made, run and scored."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from analysis.challenge.run import run_challenge
from mccdcli.main import main


@pytest.mark.slow
@pytest.mark.blind
def test_make_run_score(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "challenge")
    made = main(["challenge", "make", folder, "--family", "actuator-gain", "--shape", "short", "--seed", "4", "--json"])
    assert made == 0
    assert json.loads(capsys.readouterr().out)["cases"] == 2

    assert main(["challenge", "run", folder, "--jobs", "2", "--time-limit", "200", "--json"]) == 0
    outcomes = json.loads(capsys.readouterr().out)["outcomes"]
    words = {o["case"]: (tmp_path / "challenge" / "results" / o["case"] / "words.txt").read_text() for o in outcomes}
    # 0 says consistent, 1 that the simulation is wrong; anything else is a diagnosis that did not come to an end
    assert all(o["exit_code"] in (0, 1) for o in outcomes), words
    again = run_challenge(Path(folder))
    assert [o.wall_s for o in again] == [o["wall_s"] for o in outcomes]

    code = main(["challenge", "score", folder, "--out", str(tmp_path / "dated" / "score"), "--json"])
    score = json.loads(capsys.readouterr().out)
    assert code == (0 if score["ok"] else 1)
    assert len(score["cases"]) == 2
    # one of a gain and nothing may be a hard draw, not both
    assert any(one["right"] for one in score["cases"]), score["cases"]
    assert json.loads((tmp_path / "dated" / "score.json").read_text())["measures"] == score["measures"]
    assert (tmp_path / "dated" / "score.md").read_text().startswith("# Blind challenge, ")


def test_score_before_run_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "challenge")
    assert main(["challenge", "make", folder, "--one", "0", "--none", "1", "--shape", "short"]) == 0
    assert main(["challenge", "score", folder]) == 2
    assert "run the challenge to its end first" in capsys.readouterr().err
