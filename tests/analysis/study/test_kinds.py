"""What every kind of trial promises, that it measures what the command does, and the diagnosis as a trial."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from analysis.recorded.drift import drift_of
from analysis.recorded.hysteresis import loops_of
from analysis.recorded.sensors import endstops_of, theodolite_of
from analysis.study.definition import load_study
from analysis.study.kinds import KINDS, Setup, kind_named
from analysis.study.trial import Job, run_trial
from campaigns.benches import open_bench
from campaigns.log import Run, read_run
from campaigns.plans import make_plan
from campaigns.playing.runner import run_plan
from sim_backend.errors import ConfigError, DataError
from sim_backend.model import load_model
from tests.analysis.study.studies import EXAMPLES, HIDDEN, SMALLEST


def setup(kind: str, **more: object) -> Setup:
    model = load_model(EXAMPLES / "quiet.toml" if kind == "diagnosis" else "as-built")
    return Setup(model, model, {**SMALLEST[kind], **more}, 1)


def test_every_kind_is_tried_here() -> None:
    assert set(SMALLEST) == set(KINDS)
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


def worst_noise(run: Run) -> dict[str, Any]:
    noise = endstops_of(run).noise
    return {"noise_3sigma_m": noise.three_sigma_m.max(), "drift_m_s": np.abs(noise.drift_m_s).max()}


def widest_loop(run: Run) -> dict[str, Any]:
    loop = loops_of(run)[0.05]  # the larger of both torques
    return {"remanence_rad": loop.remanence_rad, "remanence_ratio": loop.remanence_ratio, "area_j": loop.area_j}


def gains(run: Run) -> dict[str, Any]:
    x, y = theodolite_of(run).calibration.gain_correction
    return {
        "gain_correction_theta_x": x,
        "gain_correction_theta_y": y,
        "error_rad": max(abs(x), abs(y)) * 8.5e-3,  # the full angle
    }


def worst_drift(run: Run) -> dict[str, Any]:
    test = drift_of(run)
    both = np.array([one.total_rad for one in test.drift]), np.array([one.half_width_rad for one in test.drift])
    return {
        "drift_rad": np.abs(both[0]).max(),
        "half_width_rad": both[1].max(),
        "significant": bool(np.any(np.abs(both[0]) > both[1])),
        "warming_k": run.read("temperature")[-1] - run.read("temperature")[0],
    }


@pytest.mark.parametrize(
    ("name", "measured", "more"),
    [
        ("endstops", worst_noise, {}),
        ("hysteresis", widest_loop, {"offsets_rad": []}),
        ("theodolite", gains, {}),
        ("thermal", worst_drift, {}),
    ],
)
def test_a_trial_is_the_measurement_of_the_test_that_the_command_plays(
    name: str, measured: Callable[[Run], dict[str, Any]], more: dict[str, Any], tmp_path: Path
) -> None:
    with contextlib.closing(open_bench("sim", 1)) as bench:
        run_plan(make_plan(name, {**SMALLEST[name], **more}), bench, tmp_path / "run.h5", seed=1)
    with read_run(tmp_path / "run.h5") as run:
        expected = measured(run)
    assert KINDS[name].run(setup(name)) == expected  # to the last bit: the same bench, the same measurement


@pytest.mark.parametrize(
    ("name", "words"), [("endstops", "no hardware, so no sensor"), ("theodolite", "no theodolite; give its hardware")]
)
def test_a_bench_that_lacks_the_instrument_is_refused_before_anything_runs(name: str, words: str) -> None:
    quiet = load_model(EXAMPLES / "quiet.toml")
    with pytest.raises(ConfigError, match=words):
        KINDS[name].decides(Setup(quiet, quiet, SMALLEST[name], 1))


def test_a_hysteresis_without_a_loop_comes_to_nothing_with_its_reason() -> None:
    with pytest.raises(DataError, match="torques_nm is empty"):
        KINDS["hysteresis"].run(setup("hysteresis", torques_nm=[], offsets_rad=[1e-3]))


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
