"""What every kind of trial promises, and the diagnosis as a trial."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from analysis.study.definition import load_study
from analysis.study.kinds import KINDS, Setup, kind_named
from analysis.study.trial import Job, run_trial
from sim_backend.errors import ConfigError
from sim_backend.model import load_model

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
SHORT = {"axes": ["theta_x"], "torque_rms_nm": 0.01, "stop_hz": 200.0, "period_s": 0.5, "realisations": 1}
HIDDEN = {"effect": "cubic-stiffness", "where": "theta_x", "parameters": {"stiffness": 300.0}}
SETTINGS = {
    "settling": {"cycles": 2},
    "chop": {"cycles": 1, "frequency_hz": 2.0, "window_s": 0.1},
    "diagnosis": {"hidden": HIDDEN, "plan_settings": SHORT},
}


def setup(kind: str, **more: object) -> Setup:
    model = load_model(EXAMPLES / "quiet.toml" if kind == "diagnosis" else "as-built")
    return Setup(model, model, {**SETTINGS[kind], **more}, 1)


def test_every_kind_is_tried_here() -> None:
    assert set(SETTINGS) == set(KINDS)
    with pytest.raises(ConfigError, match="did you mean 'settling'"):
        kind_named("setling")


@pytest.mark.parametrize("name", KINDS)
def test_a_trial_gives_its_columns_and_the_same_again(name: str) -> None:
    kind = KINDS[name]
    assert kind.name == name and kind.title
    assert len({c.name for c in kind.columns}) == len(kind.columns)
    found = kind.run(setup(name))
    assert list(found) == [c.name for c in kind.columns]
    types = {"number": float, "flag": bool, "text": str}
    for column in kind.columns:
        value = found[column.name]
        assert value is None or type(value) is types[column.kind], column.name
    assert kind.run(setup(name)) == found
    if name != "diagnosis":  # its words may be the same for other noise
        assert kind.run(replace(setup(name), seed=2)) != found


@pytest.mark.parametrize("name", KINDS)
def test_a_setting_that_is_none_is_refused_before_anything_runs(name: str) -> None:
    with pytest.raises(ConfigError, match="nonsense"):
        KINDS[name].decides(setup(name, nonsense=1))


def test_the_diagnosis_names_what_was_hidden_and_nothing_where_nothing_was() -> None:
    kind = KINDS["diagnosis"]
    named = kind.run(setup("diagnosis"))
    assert {k: named[k] for k in ("verdict", "seen", "right", "wrong_name")} == {
        "verdict": "named",
        "seen": True,
        "right": True,
        "wrong_name": False,
    }
    null = kind.run(setup("diagnosis", hidden={**HIDDEN, "parameters": {"stiffness": 0.0}}))
    assert {k: null[k] for k in ("verdict", "seen", "right", "wrong_name")} == {
        "verdict": "consistent",
        "seen": False,
        "right": True,
        "wrong_name": False,
    }


def test_an_effect_that_is_left_out_of_the_bench_is_not_in_the_judged_model() -> None:
    # the judged model is the one before anything was drawn; one of its own may be named
    one = setup("diagnosis")
    other = msgspec.structs.replace(one.nominal, name="drawn")
    decided = KINDS["diagnosis"].decides(Setup(other, one.nominal, one.settings, 1))
    assert 'name = "quiet"' in decided["nominal"] and "cubic" not in decided["nominal"]
    named = KINDS["diagnosis"].decides(setup("diagnosis", nominal=str(EXAMPLES / "nominal.toml")))
    assert 'name = "nominal"' in named["nominal"]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"hidden": {**HIDDEN, "effect": "cubic"}}, "did you mean"),
        ({"hidden": {**HIDDEN, "where": "theta_q"}}, "theta_q"),
        ({"nominal": "as-built"}, "no input of theta_y"),
        ({"tolerance": 0.0}, "tolerance 0"),
        ({"substeps": 0}, "substeps is 0"),
    ],
)
def test_a_diagnosis_that_cannot_be_is_refused(more: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        KINDS["diagnosis"].decides(setup("diagnosis", **more))


@pytest.mark.parametrize("name", ["spread", "power"])
def test_the_studies_of_the_documents_can_be_tried(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(EXAMPLES.parents[1])
    job = Job.of(load_study(EXAMPLES / f"{name}.toml"))
    assert run_trial(job, 0).status == "done"
