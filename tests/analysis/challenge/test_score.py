"""The arithmetic of the score on diagnoses written by hand: every verdict, every way to be right or wrong."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from analysis.challenge.judge import judge
from analysis.challenge.markdown import page
from analysis.challenge.measures import Measure, calibration
from analysis.challenge.run import diagnosed_by
from analysis.challenge.score import CHI2_MEDIAN, Score, score_challenge
from analysis.challenge.truth import Buried, Case, Number, Truth, seal
from analysis.diagnosis.tails import share_interval
from sim_backend.errors import ConfigError

FLOOR = 2e-3


def buried(
    effect: str, where: str = "theta_x", size: float = 4.0, twins: tuple[str, ...] = (), value: float = 1.0
) -> Buried:
    return Buried(
        effect=effect,
        where=where,
        parameters={"relative": Number(value=value, bound_std=0.1)},
        size=size,
        detection_limit=1.0,
        naming_limit=2.0,
        rival="delay",
        twins=[(slug, where) for slug in twins],
    )


def case(stratum: str, *effects: Buried) -> Case:
    return Case(stratum=stratum, effects=list(effects), held_out_floor=FLOOR, shape="full", axes=2)  # type: ignore[arg-type]


def named(
    *pairs: tuple[str, str], value: float = 1.0, std: float | None = 0.1, after: float = FLOOR, sure: float = 0.99
) -> dict[str, Any]:
    parameters = {"relative": {"value": value, "std": std, "unit": "1"}}
    causes = [{"effect": e, "where": w, "probability": sure, "parameters": parameters, "why": ""} for e, w in pairs]
    return {"verdict": "named", "causes": causes, "ambiguous": [], "gain": {"rms_after": after}}


def said(verdict: str, *groups: list[str]) -> dict[str, Any]:
    return {"verdict": verdict, "causes": [], "ambiguous": list(groups), "gain": None}


def write(folder: Path, diagnoses: Mapping[str, tuple[Case, dict[str, Any] | None]], wall_s: float = 5.0) -> None:
    seal(folder, Truth(seed=0, salt="", cases={name: c for name, (c, _) in diagnoses.items()}))
    (folder / "challenge.json").write_text(json.dumps({"cases": list(diagnoses)}))
    for name, (_, diagnosis) in diagnoses.items():
        out = folder / "results" / name
        out.mkdir(parents=True)
        outcome = {"case": name, "exit_code": 1, "wall_s": wall_s, "cpu_s": 1.0, "tool_version": "", "tool_commit": ""}
        (out / "run.json").write_text(json.dumps(outcome))
        if diagnosis is not None:
            (out / "diagnosis.json").write_text(json.dumps(diagnosis))


def rows(score: Score) -> dict[str, Measure]:
    """Every measure by the words before its first comma."""
    return {m.name.split(",")[0].strip(): m for m in score.measures}


def one(tmp_path: Path, hidden: Case, diagnosis: dict[str, Any] | None):
    write(tmp_path, {"0001": (hidden, diagnosis)})
    return judge(tmp_path, "0001", hidden)


GAIN = case("one", buried("sensor-gain", twins=("actuator-gain",)))


def test_right_name_at_the_right_place_is_right(tmp_path: Path) -> None:
    judged = one(tmp_path, case("one", buried("delay")), named(("delay", "theta_x"), value=1.15, after=2.1e-3))
    assert (judged.right, judged.by_name, judged.wrong) == (True, (True,), ())
    assert judged.pulls == pytest.approx([1.5])
    assert judged.spreads == pytest.approx([1.0])
    assert judged.misses == pytest.approx([2.25])
    assert judged.held_out == pytest.approx(1.05)


def test_right_name_at_the_wrong_place_is_a_wrong_name(tmp_path: Path) -> None:
    judged = one(tmp_path, case("one", buried("delay")), named(("delay", "theta_y")))
    assert not judged.right
    assert judged.wrong == (("delay", "theta_y"),)
    assert judged.held_out is None


def test_a_second_name_that_is_not_there_is_wrong(tmp_path: Path) -> None:
    judged = one(tmp_path, case("one", buried("delay")), named(("delay", "theta_x"), ("backlash", "theta_x")))
    assert judged.found == (True,)
    assert not judged.right
    assert judged.wrong == (("backlash", "theta_x"),)


def test_a_model_of_the_library_counts_as_its_cause(tmp_path: Path) -> None:
    judged = one(tmp_path, case("one", buried("hysteresis")), named(("jiles-atherton", "theta_x")))
    assert judged.right


def test_twins_called_ambiguous_are_right(tmp_path: Path) -> None:
    assert one(tmp_path, GAIN, said("ambiguous", ["actuator-gain", "sensor-gain"])).right


def test_a_needless_third_in_the_tie_is_not_right(tmp_path: Path) -> None:
    assert not one(tmp_path, GAIN, said("ambiguous", ["actuator-gain", "sensor-gain", "delay"])).right


def test_a_tie_between_what_can_be_told_apart_is_not_right(tmp_path: Path) -> None:
    judged = one(tmp_path, case("one", buried("delay")), said("ambiguous", ["delay", "amplifier-lag"]))
    assert not judged.right
    assert judged.wrong == ()


def test_a_twin_named_outright_is_a_wrong_name(tmp_path: Path) -> None:
    judged = one(tmp_path, GAIN, named(("actuator-gain", "theta_x")))
    assert not judged.right
    assert judged.wrong == (("actuator-gain", "theta_x"),)


@pytest.mark.parametrize("verdict", ["consistent", "unknown"])
def test_silence_is_not_right_but_not_wrong(tmp_path: Path, verdict: str) -> None:
    judged = one(tmp_path, case("one", buried("delay")), said(verdict))
    assert not judged.right
    assert judged.wrong == ()
    assert judged.noticed is (verdict == "unknown")


@pytest.mark.parametrize("text", [None, "not json", "[]", '{"verdict": "maybe"}'])
def test_what_cannot_be_read_failed(tmp_path: Path, text: str | None) -> None:
    hidden = case("one", buried("delay"))
    write(tmp_path, {"0001": (hidden, None)})
    if text is not None:
        (tmp_path / "results" / "0001" / "diagnosis.json").write_text(text)
    judged = judge(tmp_path, "0001", hidden)
    assert (judged.verdict, judged.right, judged.noticed) == ("failed", False, False)


def test_all_measures_together(tmp_path: Path) -> None:
    delay, null = case("one", buried("delay")), case("none")
    pair = case("two", buried("delay"), buried("backlash", "theta_y"))
    left_out = case("outside", buried("dead-zone"))
    faint = [
        (case("faint", buried("delay", size=s)), said("unknown" if s > 1.5 else "consistent")) for s in (0.5, 1, 2, 4)
    ]
    write(
        tmp_path,
        {
            "01": (delay, named(("delay", "theta_x"), value=1.1)),
            "02": (delay, named(("delay", "theta_x"), value=1.3)),  # three deviations off
            "03": (delay, named(("amplifier-lag", "theta_x"))),
            "04": (null, said("consistent")),
            "05": (null, said("unknown")),
            "06": (pair, named(("delay", "theta_x"), ("backlash", "theta_y"), std=0.2)),
            "07": (left_out, said("unknown")),
            "08": (left_out, named(("delay", "theta_x"))),
            "09": (null, None),
            **{f"1{i}": pair for i, pair in enumerate(faint)},
        },
    )
    score = score_challenge(tmp_path)
    value: dict[str, Any] = {name: (m.value, m.n, m.ok) for name, m in rows(score).items()}
    assert value["named correctly"] == (pytest.approx(2 / 3), 3, False)
    assert value["worst family"] == (pytest.approx(2 / 3), 3, False)
    assert rows(score)["worst family"].interval == pytest.approx(share_interval(2, 3))
    assert value["families below 85 %"] == (1, 1, False)
    assert value["confident wrong name"] == (pytest.approx(2 / 13), 13, False)
    # one alarm, and one that cannot be read, which is no "consistent" either
    assert value["false alarms on null campaigns"] == (pytest.approx(2 / 3), 3, False)
    assert value["out-of-library: unknown"] == (0.5, 2, False)
    assert value["two effects at once"] == (1.0, 1, True)
    assert value["both named and nothing else"] == (1.0, 1, None)
    # pulls 1, 3, 0, 0
    assert value["parameters within 2 sigma"] == (0.75, 4, False)
    # variances over the bound: 1, 1, 4, 4
    assert value["stated variance / Cramer-Rao bound"] == (2.5, 4, False)
    # squared errors over the bound: 1, 9, 0, 0
    assert value["squared error / Cramer-Rao bound"] == (pytest.approx(0.5 / CHI2_MEDIAN), 4, True)
    assert value["held-out error / error of the truth"] == (1.0, 3, True)
    assert value["diagnoses that failed"][0] == pytest.approx(1 / 13)
    assert value["slowest diagnosis of a full campaign (s)"] == (5.0, 13, True)
    assert value["within 60 s"] == (1.0, 13, None)
    # 01, 02 and both of 06 are right, 03 and 08 wrong
    assert value["names that are right"] == (pytest.approx(4 / 6), 6, False)
    assert value["with the cause in the library"][:2] == (pytest.approx(4 / 5), 5)
    assert 1.0 < value["detection limit / matched-filter bound"][0] < 2.0
    assert not score.ok
    (family,) = [f for f in score.families if f.family == "delay"]
    assert (family.n, family.found, family.said) == (3, 2, {"right": 2, "amplifier-lag": 1})


def test_page_holds_every_measure_and_what_went_wrong(tmp_path: Path) -> None:
    write(tmp_path, {"01": (case("one", buried("delay")), named(("backlash", "theta_x")))})
    score = score_challenge(tmp_path)
    text = page(score, date="2026-01-02", commands=("mccd challenge score DIR",), version="1")
    assert all(m.name.strip().replace("|", "\\|") in text for m in score.measures)
    assert "| worst family, delay | 0 | 0 – 0.975 | 1 | >= 85 % | **no** |" in text
    assert "| 01 | one | full, 2 axes | delay at theta_x (2.0 × naming limit) | named | backlash at theta_x |" in text
    assert "2026-01-02" in text


def test_a_measure_without_cases_is_neither_reached_nor_missed_but_too_few() -> None:
    measure = Measure("m", None, None, 0, 0.9, None, "", least=1)
    assert measure.ok is None
    assert (measure.enough, measure.mark, measure.counted) == (False, "too few", "0 of 1")


def test_a_score_of_too_few_cases_is_not_passed(tmp_path: Path) -> None:
    """Everything right, but of one case: neither 300 nulls nor 20 of each family, no pair, none left out."""
    write(tmp_path, {"01": (case("none"), said("consistent"))})
    score = score_challenge(tmp_path)
    assert all(m.ok is not False for m in score.measures)
    assert not score.ok
    assert score.plain()["ok"] is False
    few = rows(score)["false alarms on null campaigns"]
    assert (few.value, few.mark, few.counted) == (0.0, "too few", "1 of 300")
    text = page(score, date="2026-01-02", commands=("mccd challenge score DIR",), version="1")
    assert "| false alarms on null campaigns | 0 | 0 – 0.975 | 1 of 300 | <= 0.5 % | **too few** |" in text
    (line,) = [line for line in text.splitlines() if line.startswith("Fewer cases than the design demands: ")]
    assert "families with 20 cases or more (0 of 33)" in line
    assert "two effects at once, both named (0 of 1)" in line


def test_a_right_pair_with_a_third_name_is_named_but_not_alone(tmp_path: Path) -> None:
    pair = case("two", buried("delay"), buried("backlash", "theta_y"))
    third = named(("delay", "theta_x"), ("backlash", "theta_y"), ("dead-zone", "theta_x"))
    write(tmp_path, {"01": (pair, third), "02": (pair, named(("delay", "theta_x"), ("backlash", "theta_y")))})
    found = rows(score_challenge(tmp_path))
    assert (found["two effects at once"].value, found["both named and nothing else"].value) == (1.0, 0.5)


@pytest.mark.parametrize("std", [None, 0.0])
def test_a_parameter_without_a_sigma_is_outside_it(tmp_path: Path, std: float | None) -> None:
    delay, right = case("one", buried("delay")), ("delay", "theta_x")
    write(tmp_path, {"01": (delay, named(right, value=1.1)), "02": (delay, named(right, value=1.1, std=std))})
    found = rows(score_challenge(tmp_path))
    assert (found["parameters within 2 sigma"].value, found["parameters within 2 sigma"].n) == (0.5, 2)
    assert (found["of them without a sigma (outside)"].value, found["of them without a sigma (outside)"].n) == (1, 2)
    # the error counts, whatever was stated of it; there is no stated variance
    assert found["squared error / Cramer-Rao bound"].n == 2
    assert found["stated variance / Cramer-Rao bound"].n == 1


def test_probabilities_are_held_against_how_often_names_are_right(tmp_path: Path) -> None:
    delay, right, wrong = case("one", buried("delay")), ("delay", "theta_x"), ("backlash", "theta_x")
    cases = {f"1{i}": (delay, named(right, sure=0.995)) for i in range(8)}
    cases |= {f"2{i}": (delay, named(right, sure=0.9999)) for i in range(8)}
    cases |= {f"3{i}": (delay, named(wrong, sure=1.0)) for i in range(2)}
    cases["40"] = (delay, named(right, sure=0.9))
    write(tmp_path, cases)
    score = score_challenge(tmp_path)
    found = rows(score)
    bins = [found[f"stated {words}"] for words in ("below 0.99", "0.99 to 0.999", "0.999 to 1")]
    # the interval of 8 in 10 ends at 0.975
    assert [(m.value, m.n, m.ok) for m in bins] == [(1.0, 1, True), (1.0, 8, True), (0.8, 10, False)]
    together = found["names that are right"]
    assert together.stated == pytest.approx((8 * 0.995 + 8 * 0.9999 + 2 * 1.0 + 0.9) / 19)
    assert together.interval == pytest.approx(share_interval(17, 19))
    assert together.ok is False
    assert {row["case"]: row["stated"] for row in score.cases}["30"] == [1.0]


def test_names_less_sure_than_they_are_right_are_not_calibrated_either() -> None:
    assert calibration("m", [(0.9, True)] * 100).ok is False
    assert calibration("m", [(0.9, i % 10 > 0) for i in range(100)]).ok is True


def test_a_case_left_out_is_right_when_it_is_unknown(tmp_path: Path) -> None:
    left_out = case("outside", buried("dead-zone"))
    write(tmp_path, {"01": (left_out, said("unknown")), "02": (left_out, named(("delay", "theta_x")))})
    score = score_challenge(tmp_path)
    assert [row["right"] for row in score.cases] == [True, False]
    text = page(score, date="2026-01-02", commands=("mccd challenge score DIR",), version="1")
    assert "| 02 | outside |" in text
    assert "| 01 | outside |" not in text


def test_times_of_full_campaigns_with_their_quantiles(tmp_path: Path) -> None:
    write(tmp_path, {f"{i:02d}": (case("none"), said("consistent")) for i in range(40)})
    for i in range(40):
        path = tmp_path / "results" / f"{i:02d}" / "run.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"wall_s": 2.0 * i + 1.0, "cpu_s": float(i)}))
    found = {m.name.strip(): m for m in score_challenge(tmp_path).measures}
    assert found["slowest diagnosis of a full campaign (s)"].value == 79.0
    assert found["slowest diagnosis of a full campaign (s)"].ok is False
    assert found["within 60 s"].value == 0.75
    assert found["wall time, median (s)"].value == 40.0
    # the interval of a median of 40 is from the 14th to the 27th value (tables of the sign test)
    assert found["wall time, median (s)"].interval == (27.0, 53.0)
    assert found["processor time, largest (s)"].value == 39.0


def test_a_case_without_outcome_is_an_error(tmp_path: Path) -> None:
    write(tmp_path, {"01": (case("none"), said("consistent"))})
    (tmp_path / "results" / "01" / "run.json").unlink()
    with pytest.raises(ConfigError, match="run the challenge to its end"):
        score_challenge(tmp_path)


def test_a_score_so_far_ends_before_the_first_case_that_was_not_run(tmp_path: Path) -> None:
    """The third was run as well, but would not have been had it taken long: it must not count."""
    write(tmp_path, {f"0{i}": (case("none"), said("consistent")) for i in (1, 2, 3)})
    (tmp_path / "results" / "02" / "run.json").unlink()
    assert [row["case"] for row in score_challenge(tmp_path, so_far=True).cases] == ["01"]
    assert [row["case"] for row in score_challenge(tmp_path, first="03").cases] == ["03"]
    with pytest.raises(ConfigError, match="has no case '07'; its cases are 01 to 03"):
        score_challenge(tmp_path, so_far=True, first="07")
    (tmp_path / "results" / "01" / "run.json").unlink()
    with pytest.raises(ConfigError, match="run the challenge first"):
        score_challenge(tmp_path, so_far=True)


def test_a_score_is_of_the_tool_that_diagnosed(tmp_path: Path) -> None:
    """Whoever scores it, and by whichever version."""
    write(tmp_path, {name: (GAIN, None) for name in ("0001", "0002", "0003")})
    for name, commit in (("0001", "aaa"), ("0002", "aaa"), ("0003", "bbb")):
        path = tmp_path / "results" / name / "run.json"
        path.write_text(json.dumps(json.loads(path.read_text()) | {"tool_version": "1.2", "tool_commit": commit}))
    assert diagnosed_by(tmp_path, ["0001", "0002"]) == "1.2 (commit aaa)"
    assert diagnosed_by(tmp_path, ["0001", "0002", "0003"]) == "1.2 (commit aaa) and 1.2 (commit bbb)"


def test_a_case_that_was_not_run_is_named(tmp_path: Path) -> None:
    write(tmp_path, {name: (GAIN, None) for name in ("0001", "0002")})
    (tmp_path / "results" / "0002" / "run.json").unlink()
    with pytest.raises(ConfigError, match="case 0002 of .* was not run yet"):
        score_challenge(tmp_path, so_far=True, first="0002")
