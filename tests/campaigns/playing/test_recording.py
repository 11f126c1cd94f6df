"""A plan played into memory measures what its log would hold, and is planned once however often it is played."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from campaigns.log import read_run
from campaigns.plans import make_plan
from campaigns.playing.recording import Planned, play_in_memory
from campaigns.playing.runner import run_plan
from sim_backend.errors import ConfigError
from sim_backend.model import load_model
from sim_backend.simbench import SimBench


def test_memory_and_log_hold_the_same(tmp_path: Path) -> None:
    plan = make_plan("settling", {"cycles": 1, "strategy": "repetitive"})
    run_plan(plan, SimBench(load_model("as-built"), 4), tmp_path / "run.h5", seed=4)
    record = play_in_memory(plan, SimBench(load_model("as-built"), 4))
    with read_run(tmp_path / "run.h5") as run:
        assert record.channels == run.channels and record.rows == run.rows
        assert record.sample_rate_hz == run.sample_rate_hz
        assert [(s.label, s.start, s.stop, dict(s.settings)) for s in record.segments] == [
            (s.label, s.start, s.stop, dict(s.settings)) for s in run.segments
        ]
        for name in run.channels:
            assert np.array_equal(record.read(name), run.read(name))
            assert np.array_equal(record.read(name, 5, 9), run.read(name, 5, 9))
            # the pieces that a record is held in do not show
            cut = record.segments[0].stop
            for start, stop in ((cut - 3, cut + 4), (cut, None), (0, cut), (5, 5), (-7, None), (9, 10**9)):
                assert np.array_equal(record.read(name, start, stop), run.read(name)[start:stop])


def test_a_channel_that_is_not_there_is_told_with_those_that_are() -> None:
    record = play_in_memory(make_plan("settling", {"cycles": 1}), SimBench(load_model("as-built"), 0))
    with pytest.raises(ConfigError, match="no channel 'theta'; it has .*theta_x"):
        record.read("theta")


def test_a_plan_is_made_anew_for_another_face_alone() -> None:
    model, plan, planned = load_model("as-built"), make_plan("settling", {"cycles": 1}), Planned()
    first = planned.segments(plan, SimBench(model, 0))
    assert planned.segments(plan, SimBench(model, 1)) is first
    assert planned.segments(make_plan("settling", {"cycles": 2}), SimBench(model, 0)) is not first
    assert model.hardware is not None
    narrow = msgspec.structs.replace(model, hardware=msgspec.structs.replace(model.hardware, end_stop_angle_rad=5e-3))
    with pytest.raises(ConfigError, match=r"0\.005"):
        planned.segments(plan, SimBench(narrow, 0))


def test_only_so_many_plans_are_kept() -> None:
    bench, planned = SimBench(load_model("as-built"), 0), Planned(most=2)
    plans = [make_plan("settling", {"cycles": n}) for n in (1, 2, 3)]
    first = planned.segments(plans[0], bench)
    for plan in plans[1:]:
        planned.segments(plan, bench)
    assert planned.segments(plans[0], bench) is not first
