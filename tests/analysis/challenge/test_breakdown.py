"""Scores of the second generator: laws beyond the library, twists, traits and stated probabilities."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import msgspec
import pytest

from analysis.challenge.breakdown import reliability
from analysis.challenge.judge import judge
from analysis.challenge.pool import pool
from analysis.challenge.run import nominal_error
from analysis.challenge.score import score_challenge
from analysis.challenge.truth import Case
from analysis.diagnosis.tails import share_interval
from mccdcli.main import main
from mccdcli.schema import schema_of
from tests.analysis.challenge.test_score import buried, case, named, said, write

TRAITS = {"loop": "closed", "readings": "text"}
COULOMB, OTHER = ("coulomb-friction", "theta_x"), ("backlash", "theta_x")


def hidden(stratum: str, effect: str, law: str, traits: dict[str, str] = TRAITS, **more: Any) -> Case:
    one = msgspec.structs.replace(buried(effect), law=law, parameters={})
    return msgspec.structs.replace(case(stratum, one), traits=traits, **more)


TWISTED = hidden("twisted", "coulomb-friction", "asymmetric-coulomb")
UNLISTED = hidden("unlisted", "eddy-brake", "eddy-brake", {"loop": "open", "readings": "text"})
CASES = {
    "01": (TWISTED, named(COULOMB, sure=0.97) | {"remainder": {"share": 0.06}}),
    "02": (TWISTED, named(COULOMB, sure=0.97) | {"remainder": None}),
    "03": (TWISTED, named(COULOMB, sure=0.97)),
    "04": (TWISTED, said("unknown")),
    "05": (UNLISTED, said("unknown")),
    "06": (UNLISTED, named(OTHER, sure=0.7)),
    "07": (msgspec.structs.replace(case("none"), traits=TRAITS), said("consistent")),
}


def measures(folder: Path) -> dict[str, Any]:
    return {m.name.strip(): m for m in score_challenge(folder).measures}


def test_twists_and_laws_beyond_the_library_are_counted(tmp_path: Path) -> None:
    write(tmp_path, CASES)
    found = measures(tmp_path)
    assert found["laws that no library lists: unknown"].value == 0.5
    assert found["of these with a wrong name"].value == 0.5
    assert found["listed with a twist: named and nothing else"].value == 0.75
    told = found["of the named: a lack of fit is stated"]
    # of three names one diagnosis says nothing of a remainder, and does not count
    assert (told.value, told.n) == (0.5, 2)
    assert found["processor time of any diagnosis, median (s)"].n == 7


def test_a_challenge_of_the_first_generator_has_none_of_these_rows(tmp_path: Path) -> None:
    write(tmp_path, {"01": (case("none"), said("consistent"))})
    score = score_challenge(tmp_path)
    assert not any("library lists" in m.name for m in score.measures)
    assert score.laws == score.traits == ()


def test_cases_are_grouped_by_law_and_by_trait(tmp_path: Path) -> None:
    write(tmp_path, CASES)
    score = score_challenge(tmp_path)
    laws = {(g.kind, g.name): (g.n, g.right, g.wrong) for g in score.laws}
    assert laws == {("twisted", "asymmetric-coulomb"): (4, 3, 0), ("unlisted", "eddy-brake"): (2, 1, 1)}
    traits = {(g.kind, g.name): (g.n, g.right) for g in score.traits}
    assert traits == {("loop", "closed"): (5, 4), ("loop", "open"): (2, 1), ("readings", "text"): (7, 5)}
    (brake,) = [g for g in score.laws if g.kind == "unlisted"]
    assert brake.said == {"right": 1, "backlash": 1}


def test_names_are_binned_by_what_was_stated(tmp_path: Path) -> None:
    write(tmp_path, CASES)
    bins = {(b.low, b.high): b for b in score_challenge(tmp_path).reliability}
    assert set(bins) == {(0.5, 0.8), (0.95, 0.98)}
    sure = bins[0.95, 0.98]
    assert (sure.n, sure.right) == (3, 3) and sure.stated == pytest.approx(0.97)
    assert sure.interval == share_interval(3, 3)
    assert bins[0.5, 0.8].right == 0


def test_a_stated_probability_of_one_is_in_the_last_bin(tmp_path: Path) -> None:
    write(tmp_path, {"01": (TWISTED, named(COULOMB, sure=1.0))})
    (only,) = reliability([judge(tmp_path, "01", TWISTED)])
    assert (only.low, only.high, only.n) == (0.999, 1.0, 1)


def test_what_is_true_besides_is_no_wrong_name(tmp_path: Path) -> None:
    counts = hidden("one", "coulomb-friction", "presliding", granted=[("sensor-quantisation", "theta_x")])
    write(tmp_path, {"01": (counts, named(COULOMB, ("sensor-quantisation", "theta_x")))})
    judged = judge(tmp_path, "01", counts)
    assert judged.right
    assert [good for _, good in judged.stated] == [True, True]
    (tmp_path / "else").mkdir()
    elsewhere = named(COULOMB, ("sensor-quantisation", "theta_y"))
    write(tmp_path / "else", {"01": (counts, elsewhere)})
    assert judge(tmp_path / "else", "01", counts).wrong == (("sensor-quantisation", "theta_y"),)


def test_the_score_is_as_its_schema_says_and_pools(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "blind"
    folder.mkdir()
    write(folder, CASES)
    assert main(["challenge", "score", str(folder), "-o", str(tmp_path / "score"), "--json"]) == 1
    jsonschema.validate(json.loads(capsys.readouterr().out), schema_of("challenge score"))
    assert pool([tmp_path / "score.json"]) == score_challenge(folder)
    text = (tmp_path / "score.md").read_text()
    assert "## Laws" in text
    assert "| unlisted | eddy-brake | 1/2 |" in text
    assert "| loop | closed | 4/5 |" in text
    assert "| 0.95 to 0.98 | 0.9700 | 3 | 1 |" in text


def test_how_wrong_nominal_numbers_are_is_what_the_challenge_states(tmp_path: Path) -> None:
    path = tmp_path / "challenge.json"
    path.write_text(json.dumps({"cases": []}))
    assert nominal_error(tmp_path) == 0.03
    path.write_text(json.dumps({"cases": [], "nominal_error": 0.05}))
    assert nominal_error(tmp_path) == 0.05
