"""The arithmetic of the score on diagnoses written by hand: every verdict, every way to be right or wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from campaigns.challenge.judge import judge
from campaigns.challenge.markdown import page
from campaigns.challenge.run import diagnosed_by
from campaigns.challenge.score import CHI2_MEDIAN, Measure, score_challenge
from campaigns.challenge.truth import Buried, Case, Number, Truth, seal
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


def named(*pairs: tuple[str, str], value: float = 1.0, std: float = 0.1, after: float = FLOOR) -> dict[str, Any]:
    parameters = {"relative": {"value": value, "std": std, "unit": "1"}}
    causes = [{"effect": e, "where": w, "probability": 0.99, "parameters": parameters, "why": ""} for e, w in pairs]
    return {"verdict": "named", "causes": causes, "ambiguous": [], "gain": {"rms_after": after}}


def said(verdict: str, *groups: list[str]) -> dict[str, Any]:
    return {"verdict": verdict, "causes": [], "ambiguous": list(groups), "gain": None}


def write(folder: Path, diagnoses: dict[str, tuple[Case, dict[str, Any] | None]], wall_s: float = 5.0) -> None:
    seal(folder, Truth(seed=0, salt="", cases={name: c for name, (c, _) in diagnoses.items()}))
    (folder / "challenge.json").write_text(json.dumps({"cases": list(diagnoses)}))
    for name, (_, diagnosis) in diagnoses.items():
        out = folder / "results" / name
        out.mkdir(parents=True)
        outcome = {"case": name, "exit_code": 1, "wall_s": wall_s, "cpu_s": 1.0, "tool_version": "", "tool_commit": ""}
        (out / "run.json").write_text(json.dumps(outcome))
        if diagnosis is not None:
            (out / "diagnosis.json").write_text(json.dumps(diagnosis))


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
    value = {m.name.split(",")[0].strip(): (m.value, m.n, m.ok) for m in score.measures}
    assert value["named correctly"] == (pytest.approx(2 / 3), 3, False)
    assert value["worst family"] == (pytest.approx(2 / 3), 1, False)
    assert value["confident wrong name"] == (pytest.approx(2 / 13), 13, False)
    # one alarm, and one that cannot be read, which is no "consistent" either
    assert value["false alarms on null campaigns"] == (pytest.approx(2 / 3), 3, False)
    assert value["out-of-library: unknown"] == (0.5, 2, False)
    assert value["two effects at once"] == (1.0, 1, True)
    # pulls 1, 3, 0, 0
    assert value["parameters within 2 sigma"] == (0.75, 4, False)
    # variances over the bound: 1, 1, 4, 4
    assert value["stated variance / Cramer-Rao bound"] == (2.5, 4, False)
    # squared errors over the bound: 1, 9, 0, 0
    assert value["squared error / Cramer-Rao bound"] == (pytest.approx(0.5 / CHI2_MEDIAN), 4, True)
    assert value["held-out error / error of the truth"] == (1.0, 3, True)
    assert value["diagnoses that failed"][0] == pytest.approx(1 / 13)
    assert value["slowest diagnosis of a full campaign (s)"] == (5.0, 13, True)
    assert 1.0 < value["detection limit / matched-filter bound"][0] < 2.0
    assert not score.ok
    (family,) = [f for f in score.families if f.family == "delay"]
    assert (family.n, family.found, family.said) == (3, 2, {"right": 2, "amplifier-lag": 1})


def test_page_holds_every_measure_and_what_went_wrong(tmp_path: Path) -> None:
    write(tmp_path, {"01": (case("one", buried("delay")), named(("backlash", "theta_x")))})
    score = score_challenge(tmp_path)
    text = page(score, date="2026-01-02", commands=("mccd challenge score DIR",), version="1")
    assert all(m.name.strip().replace("|", "\\|") in text for m in score.measures)
    assert "| 01 | one | full, 2 axes | delay at theta_x (2.0 × naming limit) | named | backlash at theta_x |" in text
    assert "2026-01-02" in text


def test_a_measure_without_cases_neither_passes_nor_fails() -> None:
    assert Measure("m", None, None, 0, 0.9, None, "").ok is None


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
