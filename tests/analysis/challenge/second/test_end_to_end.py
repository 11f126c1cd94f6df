"""A tiny challenge of the second generator from the command line: made, run, scored."""

from __future__ import annotations

import json
from pathlib import Path

import jsonschema
import pytest

from mccdcli.main import main
from mccdcli.schema import schema_of


@pytest.mark.slow
@pytest.mark.blind
def test_make_run_score(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(tmp_path / "challenge")
    words = ["--generator", "second", "--one", "0", "--none", "1", "--seed", "2", "--json"]
    assert main(["challenge", "make", folder, *words]) == 0
    made = json.loads(capsys.readouterr().out)
    jsonschema.validate(made, schema_of("challenge make"))
    assert made["cases"] == 1
    assert main(["challenge", "run", folder, "--json"]) == 0
    (outcome,) = json.loads(capsys.readouterr().out)["outcomes"]
    # 0 says consistent, 1 that the simulation is wrong; anything else is a diagnosis that could not read its case
    assert outcome["exit_code"] in (0, 1), (tmp_path / "challenge" / "results" / "0001" / "words.txt").read_text()
    main(["challenge", "score", folder, "--json"])
    score = json.loads(capsys.readouterr().out)
    jsonschema.validate(score, schema_of("challenge score"))
    assert score["cases"][0]["traits"]["loop"] in ("open", "closed")
