"""What every plan promises: counted before it is played, within limits, pure data, and logged as it was played."""

from __future__ import annotations

import json
from typing import Any

import h5py
import numpy as np
import pytest

from campaigns.plans import PLANS, checked_segments, estimate, make_plan
from campaigns.playing.runner import run_plan
from sim_backend.bench import Record, Segment
from sim_backend.errors import ConfigError
from sim_backend.model import dump_model
from sim_backend.simbench import SimBench
from tests.small_bench import NOISE, bench_model

# what makes each plan short; a plan that is not here is tested with its defaults
SHORT: dict[str, dict[str, Any]] = {
    "chop": {"cycles": 1, "frequency_hz": 2.0, "window_s": 0.1, "alpha_deg": 120.0},
    "endstops": {"ramp_s": 0.02, "settle_s": 0.02, "hold_s": 0.02},
    "freerun": {"steps_s": 0.5, "noise_s": 0.2, "held_out_s": 0.2},
    "hysteresis": {"frequency_hz": 5.0, "settle_s": 0.05, "ramp_s": 0.05},
    "multisine": {"period_s": 0.05, "start_hz": 20.0, "realisations": 1},
    "rest": {"duration_s": 0.5, "settle_s": 0.1},
    "settling": {"cycles": 2, "strategy": "repetitive", "tuning": {"learning_s": 0.5}},
    "sinesweep": {"bands": [{"start_hz": 20.0, "stop_hz": 60.0, "step_hz": 20.0, "settle_s": 0.05, "measure_s": 0.1}]},
    "theodolite": {"move_s": 0.02, "settle_s": 0.02, "hold_s": 0.02},
    "thermal": {"cycles": 3},
}


class Face:
    """The public face of a bench and nothing else: a plan that moves something fails here."""

    def __init__(self, bench: SimBench) -> None:
        self.identity, self.signals, self.axes, self.limits = bench.identity, bench.signals, bench.axes, bench.limits
        self.made_safe = 0

    def play(self, segment: Segment) -> Record:
        raise AssertionError(f"'{segment.label}' was played")

    def safe(self) -> None:
        self.made_safe += 1

    def close(self) -> None:
        """There is nothing to let go of."""


@pytest.fixture(params=sorted(PLANS))
def plan(request, tmp_path):
    settings = dict(SHORT.get(request.param, {}))
    if "model" in PLANS[request.param].__struct_fields__:
        path = tmp_path / "design.toml"
        path.write_text(dump_model(bench_model(hardware=False)), encoding="utf-8")
        settings["model"] = str(path)
    return make_plan(request.param, settings)


def small_bench(**limits):
    return SimBench(bench_model(NOISE, **limits), 3)


def test_what_is_counted_is_what_is_played(plan, tmp_path):
    counted = estimate(plan, Face(small_bench()))
    outcome = run_plan(plan, small_bench(), tmp_path / "run.h5", seed=3)
    assert outcome.status == "complete" and outcome.estimate == counted
    with h5py.File(tmp_path / "run.h5") as file:
        channels = [file["channels"][name][:] for name in file["channels"]]
        assert len(channels) == counted.channels
        assert {c.size for c in channels} == {counted.samples}
        assert sum(c.nbytes for c in channels) == counted.bytes
        assert len(file["segments"]) == counted.segments == outcome.segments
    assert counted.duration_s == pytest.approx(counted.samples / 10_000.0, rel=1e-12)


def test_recorded_commands_keep_the_limits(plan):
    bench = small_bench()
    limits = bench.limits
    peak = estimate(plan, bench).peak_current_a
    assert 0.0 <= peak <= limits.current_a
    for segment in checked_segments(plan, bench):
        assert np.all(np.abs(segment.reference) <= limits.reference)
        record = bench.play(segment)
        names = [f"command_{axis}" for axis in bench.axes]
        if all(name in record.channels for name in names):
            current = np.stack([record.channels[n] for n in names], axis=1) @ limits.to_current.T
            assert np.max(np.abs(current)) <= limits.current_a


def test_segments_are_pure_data(plan):
    face = Face(small_bench())
    for first, second in zip(checked_segments(plan, face), checked_segments(plan, face), strict=True):
        assert first.label == second.label and first.n_samples == second.n_samples
        assert first.settings == second.settings and first.gates == second.gates
        for name in ("reference", "feedforward"):
            values = getattr(first, name)
            assert np.all(np.isfinite(values))
            np.testing.assert_array_equal(values, getattr(second, name))


def test_settings_survive_their_round_trip_as_json(plan):
    assert make_plan(plan.name, json.loads(json.dumps(plan.settings()))) == plan


def test_an_unknown_setting_is_named_with_those_there_are(plan):
    with pytest.raises(ConfigError, match="(?s)speed.*settings are"):
        make_plan(plan.name, {"speed": 1.0})


def test_the_log_holds_what_the_bench_measured(plan, tmp_path):
    run_plan(plan, small_bench(), tmp_path / "run.h5", seed=3)
    again = small_bench()
    records = [again.play(segment) for segment in checked_segments(plan, again)]
    with h5py.File(tmp_path / "run.h5") as file:
        assert file.attrs["test"] == plan.name and file.attrs["status"] == "complete"
        assert json.loads(file.attrs["configuration"])["settings"] == json.loads(json.dumps(plan.settings()))
        for name in file["channels"]:
            np.testing.assert_array_equal(
                file["channels"][name][:], np.concatenate([r.channels[name] for r in records])
            )
        stops = np.cumsum([r.segment.n_samples for r in records])
        np.testing.assert_array_equal(file["segments"]["stop"], stops)
        for row, record in zip(file["segments"], records, strict=True):
            assert row["label"].decode() == record.segment.label
            assert json.loads(row["settings"]) == pytest.approx(record.segment.settings)


@pytest.mark.parametrize("limit", [{"peak_current_a": 1e-9}, {"end_stop_rad": 1e-9}])
def test_a_demand_beyond_a_limit_is_refused_before_anything_moves(plan, limit, tmp_path):
    generous = estimate(plan, Face(small_bench()))
    asks = generous.peak_current_a if "peak_current_a" in limit else max(generous.peak_reference.values())
    if asks == 0.0:
        pytest.skip(f"{plan.name} asks nothing of this limit")
    with pytest.raises(ConfigError, match="1e-09"):
        run_plan(plan, Face(small_bench(**limit)), tmp_path / "run.h5", seed=3)
    assert not (tmp_path / "run.h5").exists()
