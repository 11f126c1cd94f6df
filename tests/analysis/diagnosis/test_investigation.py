"""Investigations from end to end: what is hidden in a bench is found by running, diagnosing, choosing, running on."""

from __future__ import annotations

import json
import signal
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from analysis.diagnosis.experiment.planned import BenchDescription, first_plan
from analysis.diagnosis.investigation import Quest, investigate
from analysis.diagnosis.pipeline import Options
from campaigns.log import read_run
from campaigns.plans import make_plan
from campaigns.plans.multisine import Multisine
from sim_backend.errors import ConfigError
from sim_backend.model import EffectEntry, dump_model
from sim_backend.simbench import SimBench
from tests.small_bench import bench_model

NOISE_M = 2e-8
SHORT = {"axes": ["theta_x"], "realisations": 1, "period_s": 0.5, "start_hz": 2.0, "stop_hz": 500.0}
OPTIONS = Options(tolerance=0.01)


def models(tmp_path, rate_hz, *effects, theodolite_rad=None):
    """Return the address of a bench with hidden `effects`, and the nominal model, which has neither them nor noise."""
    noise = tuple(
        EffectEntry(effect="sensor-noise", where=head, parameters={"std": NOISE_M}) for head in ("S1", "S2", "S3")
    )

    def model(*entries):
        plain = bench_model(entries)
        assert plain.hardware is not None
        hardware = msgspec.structs.replace(plain.hardware, theodolite_noise_rad=theodolite_rad)
        return msgspec.structs.replace(plain, sample_rate_hz=rate_hz, hardware=hardware)

    path = tmp_path / "bench.toml"
    path.write_text(dump_model(model(*noise, *effects)), encoding="utf-8")
    return f"sim:{path}", model()


def hidden(effect, **parameters):
    return EffectEntry(effect=effect, where="theta_x", parameters=parameters)


def diagnosis_of(folder, number):
    return json.loads((folder / f"round-{number}" / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))


def test_what_a_slow_loop_leaves_tied_the_next_experiment_names(tmp_path):
    """At rest a spring that hardens and a drive that weakens with the deflection are the same; in motion they are not.

    0.3 % of force constant at the 1.8 mrad that the first experiment reaches.
    """
    bench, nominal = models(tmp_path, 2000.0, hidden("position-dependent-force-constant", quadratic=-900.0))
    slow = {"torques_nm": [0.02], "offsets_rad": [], "frequency_hz": 0.5, "cycles": 4}
    told: list[str] = []
    quest = Quest(bench, nominal, first=make_plan("hysteresis", slow), options=OPTIONS)
    found = investigate(quest, tmp_path / "out", remark=told.append)
    first, second = found.rounds
    assert first.verdict == "ambiguous"
    assert set(first.ambiguous[0]) == {"cubic-stiffness", "position-dependent-force-constant"}
    proposed = first.next_experiment
    assert proposed is not None
    assert proposed["expected_sigma"] > 7.0 and set(proposed["separates"]) == set(first.ambiguous[0])
    assert proposed["test"] in first.sentence
    assert second.plan == proposed["test"] and second.settings == proposed["settings"]
    assert found.verdict == second.verdict == "named"
    assert second.causes == ("position-dependent-force-constant at theta_x",)
    estimate = diagnosis_of(found.folder, 2)["causes"][0]["parameters"]["quadratic"]
    # five standard deviations, and 1 % for the search's finer steps between samples
    assert abs(estimate["value"] + 900.0) < 5.0 * estimate["std"] + 0.01 * 900.0
    assert any(line.startswith("round 2: named") for line in told)
    page = (found.folder / "round-1" / "diagnosis" / "index.html").read_text(encoding="utf-8")
    assert f"Next experiment: {proposed['test']}" in page


def test_a_model_of_one_axis_has_a_first_plan_on_a_bench_of_three(tmp_path):
    three = bench_model()
    one = msgspec.structs.replace(
        three, name="one", inputs=three.inputs[:1], outputs=three.outputs[:1], modes=three.modes[:1], hardware=None
    )
    description = BenchDescription.of(SimBench(three, 0))
    plan, whole = first_plan(description, one), first_plan(description, three)
    assert isinstance(plan, Multisine) and isinstance(whole, Multisine)
    assert (plan.name, plan.axes) == ("multisine", ("theta_x",))
    # the axes are driven one after the other, so that what one may have does not depend on the others
    assert plan.torque_rms_nm == pytest.approx(whole.torque_rms_nm, rel=0.1)


def gain(tmp_path, effect, theodolite_rad, **quest):
    bench, nominal = models(tmp_path, 5000.0, hidden(effect, relative=0.1), theodolite_rad=theodolite_rad)
    plan = make_plan("multisine", SHORT)
    return investigate(Quest(bench, nominal, first=plan, options=OPTIONS, **quest), tmp_path / "out")


@pytest.mark.parametrize("effect", ["sensor-gain", "actuator-gain"])
def test_an_instrument_beside_the_bench_decides_between_two_gains(tmp_path, effect):
    found = gain(tmp_path, effect, 2.5e-6)
    assert found.rounds[0].verdict == "ambiguous"
    assert set(found.rounds[0].ambiguous[0]) == {"sensor-gain", "actuator-gain"}
    assert found.rounds[0].next_experiment["test"] == "theodolite"
    assert found.verdict == "named" and found.rounds[-1].causes == (f"{effect} at theta_x",)
    assert len(found.rounds) == 2
    notes = " ".join(diagnosis_of(found.folder, 2)["notes"])
    assert "instrument beside the bench" in notes


def test_two_gains_stay_tied_where_no_instrument_sees_the_angle(tmp_path):
    found = gain(tmp_path, "sensor-gain", None)
    assert found.verdict == "ambiguous" and len(found.rounds) == 1
    assert set(found.rounds[0].ambiguous[0]) == {"sensor-gain", "actuator-gain"}
    assert found.rounds[0].next_experiment is None
    assert "no further experiment that this bench can do" in found.reason
    assert "No plan distinguishes" in found.rounds[0].sentence


def test_the_rounds_and_the_budget_are_kept(tmp_path):
    found = gain(tmp_path, "sensor-gain", 2.5e-6, rounds=1)
    assert found.verdict == "ambiguous" and "--rounds" in found.reason and "theodolite" in found.reason
    with pytest.raises(ConfigError, match="--resume"):
        gain(tmp_path, "sensor-gain", 2.5e-6)
    bench, nominal = models(tmp_path, 5000.0)
    poor = investigate(Quest(bench, nominal, budget_s=1.0), tmp_path / "poor")
    assert poor.verdict == "" and "--budget-s" in poor.reason and poor.rounds == ()
    assert not list((tmp_path / "poor").glob("**/*.h5"))
    with pytest.raises(ConfigError, match="cannot be resumed: seed was 0 and is 1;"):
        investigate(Quest(bench, nominal, seed=1, budget_s=1.0), tmp_path / "poor", resume=True)


def test_a_model_that_is_right_ends_at_once_and_an_interrupt_loses_nothing(tmp_path):
    bench, nominal = models(tmp_path, 2000.0)
    quest, folder = Quest(bench, nominal, options=OPTIONS, first=make_plan("multisine", SHORT)), tmp_path / "out"

    def interrupt(done, total, what):
        if what.endswith("multisine 1.1"):
            signal.raise_signal(signal.SIGINT)

    stopped = investigate(quest, folder, report=interrupt)
    assert stopped.paused and stopped.verdict == ""
    state = json.loads((folder / "investigation.json").read_text(encoding="utf-8"))
    assert state["status"] == "paused" and state["rounds"][0]["plan"] == "multisine"

    found = investigate(quest, folder, resume=True)
    assert not found.paused and found.verdict == "consistent" and len(found.rounds) == 1
    assert (folder / "round-1" / "multisine.partial-1.h5").is_file()
    with read_run(folder / "round-1" / "multisine.h5") as run:
        assert run.status == "complete"

    written = (folder / "round-1" / "diagnosis" / "diagnosis.json").stat().st_mtime_ns
    again = investigate(quest, folder, resume=True)
    assert again.rounds == found.rounds
    assert (folder / "round-1" / "diagnosis" / "diagnosis.json").stat().st_mtime_ns == written

    with pytest.raises(ConfigError, match="seed"):
        investigate(Quest(bench, nominal, 5, options=OPTIONS), folder, resume=True)


def test_the_first_plan_moves_as_far_as_the_bench_allows_and_no_further():
    model = msgspec.structs.replace(bench_model(), sample_rate_hz=2000.0)
    bench = SimBench(model, 0, truth=True)
    plan = first_plan(BenchDescription.of(SimBench(model, 0)), model)
    travel = np.zeros(3)
    for segment in plan.segments(bench):
        record = bench.play(replace(segment, record=()))
        travel = np.maximum(travel, [np.max(np.abs(record.channels[f"true_{dof}"])) for dof in bench.axes])
    assert np.all(travel <= 0.9 * bench.limits.reference)
    # levels are a factor of two to two and a half apart, so the next larger one would not have kept the limits
    assert np.max(travel / bench.limits.reference) > 0.9 / 2.5


def test_a_bench_without_limits_is_asked_for_the_plans_own_size():
    model = bench_model(hardware=False)
    plan = first_plan(BenchDescription.of(SimBench(model, 0)), model)
    own = make_plan("multisine", {})
    assert isinstance(plan, Multisine) and isinstance(own, Multisine)
    assert plan.torque_rms_nm == own.torque_rms_nm


def test_a_bench_of_other_axes_is_refused_by_name():
    model = bench_model(hardware=False)
    other = msgspec.structs.replace(
        model, inputs=[msgspec.structs.replace(p, dof=f"other_{p.dof}") for p in model.inputs]
    )
    with pytest.raises(ConfigError, match="other_theta_x"):
        first_plan(BenchDescription.of(SimBench(model, 0)), other)


def test_a_model_with_more_than_the_bench_has_is_refused_before_anything_moves(tmp_path):
    bench, nominal = models(tmp_path, 2000.0)
    renamed = [msgspec.structs.replace(p, dof="theta_q") if p.dof == "theta_y" else p for p in nominal.outputs]
    quest = Quest(bench, msgspec.structs.replace(nominal, outputs=renamed), first=make_plan("multisine", SHORT))
    with pytest.raises(ConfigError, match="no output of theta_q"):
        investigate(quest, tmp_path / "out")
    assert not list((tmp_path / "out").glob("**/*.h5"))
