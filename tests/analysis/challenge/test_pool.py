"""A challenge scored in parts and pooled is the challenge scored at once."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from analysis.challenge.pool import pool
from analysis.challenge.score import score_challenge
from mccdcli.main import main
from sim_backend.errors import ConfigError, DataError
from tests.analysis.challenge.test_score import GAIN, buried, case, named, said, write

DELAY = case("one", buried("delay"))
PAIR = case("two", buried("delay"), buried("backlash", "theta_y"))
FAINT = [(case("faint", buried("delay", size=s)), said("unknown" if s > 1.5 else "consistent")) for s in (0.5, 1, 2, 4)]
CASES = {
    "01": (DELAY, named(("delay", "theta_x"), value=1.1, sure=0.995)),
    "02": (DELAY, named(("amplifier-lag", "theta_x"))),
    "03": (GAIN, said("ambiguous", ["actuator-gain", "sensor-gain"])),
    "04": (case("none"), said("consistent")),
    "05": (PAIR, named(("delay", "theta_x"), ("backlash", "theta_y"), std=None)),
    "06": (case("outside", buried("dead-zone")), said("unknown")),
    "07": (case("none"), None),
    **{f"1{i}": pair for i, pair in enumerate(FAINT)},
}


@pytest.fixture
def parts(tmp_path: Path) -> tuple[Path, list[Path]]:
    """A challenge, and the documents of its scores in two parts; the first part was all that had been run by then."""
    folder, scores = tmp_path / "blind", [tmp_path / "early.json", tmp_path / "late.json"]
    folder.mkdir()
    write(folder, CASES)
    waiting = {name: folder / "results" / name / "run.json" for name in CASES if name > "03"}
    kept = {name: path.read_text() for name, path in waiting.items()}
    for path in waiting.values():
        path.unlink()
    assert main(["challenge", "score", str(folder), "--so-far", "-o", str(scores[0].with_suffix(""))]) == 1
    for name, path in waiting.items():
        path.write_text(kept[name])
    assert main(["challenge", "score", str(folder), "--from", "04", "-o", str(scores[1].with_suffix(""))]) == 1
    return folder, scores


def test_parts_make_the_whole(parts: tuple[Path, list[Path]], tmp_path: Path) -> None:
    folder, scores = parts
    assert [len(json.loads(path.read_text())["cases"]) for path in scores] == [3, 8]
    assert pool(scores) == score_challenge(folder)
    assert main(["challenge", "pool", *map(str, scores), "-o", str(tmp_path / "whole")]) == 1
    assert main(["challenge", "score", str(folder), "-o", str(tmp_path / "once")]) == 1
    pooled, once = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("whole", "once"))
    assert pooled == once
    assert "mccd challenge pool early.json late.json" in (tmp_path / "whole.md").read_text()


def test_no_case_counts_twice(parts: tuple[Path, list[Path]]) -> None:
    early, late = parts[1]
    with pytest.raises(ConfigError, match="case 01 is in"):
        pool([early, late, early])


def test_the_same_name_in_another_challenge_is_another_case(parts: tuple[Path, list[Path]], tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    write(other, {"01": CASES["04"]})
    main(["challenge", "score", str(other), "-o", str(tmp_path / "other")])
    scores = [parts[1][0], tmp_path / "other.json"]
    both = pool(scores)
    assert [row["case"] for row in both.cases] == ["01", "02", "03", "01"]
    assert len(both.seal.split(" and ")) == 2
    # whose case is whose a document of both does not tell
    main(["challenge", "pool", *map(str, scores), "-o", str(tmp_path / "both")])
    with pytest.raises(ConfigError, match="both.json is of several challenges already: give the scores"):
        pool([tmp_path / "both.json", parts[1][1]])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("no json", "not valid JSON"),
        ("[]", "has the form None"),
        ('{"schema": "mccd-challenge-score/2", "cases": []}', "score its challenge again"),
        ('{"schema": "mccd-challenge-score/3", "seal": "a", "cases": [{"case": "01"}]}', "holds a case that cannot"),
    ],
)
def test_what_is_no_score_is_refused(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "score.json"
    path.write_text(text)
    with pytest.raises(DataError, match=words):
        pool([path])
